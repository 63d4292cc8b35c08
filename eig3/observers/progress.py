"""The progress bar of a run, which needs tqdm."""

from __future__ import annotations

from typing import Any

from .chunk import Chunk


def check_progress(progress: bool) -> None:
    """Raise an ImportError if a progress bar is requested and tqdm is not installed."""
    if progress:
        try:
            import tqdm.auto  # noqa: F401
        except ImportError:
            raise ImportError("progress=True needs tqdm: pip install tqdm.") from None


class Progress:
    """A progress bar that counts steps."""

    def __init__(self, n_steps: int) -> None:
        from tqdm.auto import tqdm

        self._bar: Any = tqdm(total=n_steps, unit="step", unit_scale=True)

    def see(self, chunk: Chunk) -> None:
        self._bar.update(chunk.stepper.index - chunk.first)

    def close(self) -> None:
        self._bar.close()
