"""A progress bar where one is asked for."""

import contextlib
from collections.abc import Callable, Iterator


def check_progress(progress: bool) -> None:
    """Raise an ImportError where a bar is asked for and tqdm is not installed."""
    if progress:
        try:
            import tqdm.auto  # noqa: F401
        except ImportError:
            raise ImportError("progress=True needs tqdm: pip install tqdm.") from None


@contextlib.contextmanager
def progress_bar(progress: bool, n_steps: int) -> Iterator[Callable[[int], object]]:
    """Give a function to call with the number of steps just taken."""
    if not progress:
        yield lambda steps: None
        return
    from tqdm.auto import tqdm

    with tqdm(total=n_steps, unit="step", unit_scale=True) as bar:
        yield bar.update
