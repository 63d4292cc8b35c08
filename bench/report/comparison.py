"""Two runs of the report side by side: how the times of each method changed, and whether by more than the noise."""

from __future__ import annotations

import math
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import groupby

from .. import text
from ..environment import in_words
from ..rivals import RIVALS
from ..sweep import CERTAIN
from .record import Record

CONFIDENCE = 0.99  # of the noise
LEAST = 0.03  # no smaller change of the time is marked
CHANGED = 0.01  # a method whose error changes by more computes something else
_ROUND_OFF = 1e-11  # smaller errors may change from machine to machine
SLOWER, FASTER = "slower", "faster"


@dataclass(frozen=True)
class Timing:
    """The times of one method on one problem at one setting, and its errors; an unstable run has no times.

    `uncertainty` belongs to the errors of the trajectory.
    """

    problem: str
    mode: str
    method: str
    label: str
    setting: str
    seconds: Sequence[float]
    errors: Mapping[str, float]
    uncertainty: float = 0.0

    @property
    def key(self) -> tuple[str, str, str, str]:
        return self.problem, self.mode, self.method, self.setting

    @property
    def words(self) -> str:
        return ", ".join(word for word in (self.problem, self.mode, self.label, self.setting) if word)

    @property
    def is_ours(self) -> bool:
        """Whether its code is part of the library: not a rival, and not the code in C."""
        return self.method not in RIVALS and not self.mode.startswith("C ")

    @property
    def package(self) -> str:
        """The package of a rival; empty for the others."""
        return RIVALS[self.method].package if self.method in RIVALS else ""


@dataclass(frozen=True)
class Row:
    """One method on one problem in one mode: the ratio of its times in both runs.

    Attributes
    ----------
    first : Timing
        At the first of its settings.
    settings : int
        The number of steps or tolerances that both runs have.
    ratio : float
        The new median time over the old one, as the geometric mean over these settings.
    noise : float
        The factor, above 1, by which the ratio may be wrong; infinite if the repeats cannot tell.
    """

    first: Timing
    settings: int
    ratio: float
    noise: float

    @property
    def mark(self) -> str:
        """Return "slower" or "faster" if the change is larger than the noise and than `LEAST`; otherwise empty."""
        if abs(math.log(self.ratio)) <= max(math.log(self.noise), math.log1p(LEAST)):
            return ""
        return SLOWER if self.ratio > 1 else FASTER


@dataclass(frozen=True)
class Comparison:
    """Two runs side by side.

    Attributes
    ----------
    new, old : Record
    rows : list of Row
        In the order of the new run.
    changed : list of str
        What became stable or unstable, and the errors that are not the same, in words.
    unpaired : list of str
        What only one of the runs has, in words.
    """

    new: Record
    old: Record
    rows: list[Row]
    changed: list[str]
    unpaired: list[str]

    @classmethod
    def of(cls, new: Record, old: Record) -> Comparison:
        """Pair what both records have: same problem, mode, method and setting."""
        news, olds = ({timing.key: timing for timing in timings(record)} for record in (new, old))
        pairs = [(timing, olds[key]) for key, timing in news.items() if key in olds]
        changed = [sentence for pair in pairs for sentence in _changed(*pair)]
        timed = [pair for pair in pairs if all(timing.seconds for timing in pair)]
        return cls(new, old, list(_rows(timed)), changed, [*_lonely(news, olds), *_lonely(olds, news)])

    @property
    def other_versions(self) -> dict[str, str]:
        """The packages of rivals whose versions in both runs are not the same or not known, and these versions."""
        packages = dict.fromkeys(row.first.package for row in self.rows if row.first.package)
        versions = {name: [record.run.environment.get(name) for record in (self.new, self.old)] for name in packages}
        return {
            name: f"{new or 'unknown'}, before {old or 'unknown'}"
            for name, (new, old) in versions.items()
            if new != old or not new
        }

    @property
    def control(self) -> float | None:
        """The geometric mean of the ratios of the code that is the same in both runs; None if there is none."""
        same = [row for row in self.rows if not row.first.is_ours and row.first.package not in self.other_versions]
        logarithms = [math.log(row.ratio) for row in same]
        return math.exp(statistics.fmean(logarithms)) if logarithms else None

    @property
    def marked(self) -> list[Row]:
        """The methods of the library that became slower or faster."""
        return [row for row in self.rows if row.mark and row.first.is_ours]

    @property
    def summary(self) -> str:
        """How many methods became slower or faster, how many by noise alone, and how the machine changed."""
        ours = [row for row in self.rows if row.first.is_ours]
        counts = {mark: sum(row.mark == mark for row in ours) for mark in (SLOWER, FASTER)}
        words = " and ".join(f"{count} became {mark}" for mark, count in counts.items())
        control = (
            "The rivals and the code in C, whose source is the same in both runs, take "
            f"{text.ratio(self.control, 3)} of their time: so much of each ratio is the machine, its load and its "
            "versions."
            if self.control
            else "No rival of the same version is in both runs, so nothing shows how the machine and its load changed."
        )
        if self.other_versions:
            others = "; ".join(f"{name} ({versions})" for name, versions in self.other_versions.items())
            control += f" Rivals of another version say nothing about it: {others}."
        return (
            f"Of {len(ours)} pairs of a problem and a method, {words} by more than the noise. Noise alone marks "
            f"{(1 - CONFIDENCE) * len(ours):.3g} of them on average, or fewer. {control}"
        )

    @property
    def everything(self) -> str:
        """The table of all pairs, with the rivals."""
        return _table(self.rows)

    @property
    def markdown(self) -> str:
        """Both machines, the summary, and a table of what is marked; then what else differs."""
        parts = [
            f"New: {in_words(self.new.run.environment)}, by `{self.new.run.command}`.",
            f"Old: {in_words(self.old.run.environment)}, by `{self.old.run.command}`.",
            self.summary,
        ]
        if self.marked:
            parts.append(_table(sorted(self.marked, key=lambda row: -row.ratio)))
        parts.append(
            "A ratio is the geometric mean over the settings that both runs have. The noise is the half width of its "
            f"{100 * CONFIDENCE:.0f} % interval, from the rounds of both runs. A change of less than "
            f"{100 * LEAST:.0f} % is not marked."
        )
        if self.changed:
            parts += [
                f"What became stable or unstable, and errors that changed by more than {100 * CHANGED:.0f} %. Errors "
                f"below {CERTAIN} times the uncertainty of the truth, or below {_ROUND_OFF:g}, are left out:",
                "\n".join(f"- {line}" for line in self.changed),
            ]
        if self.unpaired:
            parts += ["In one of the runs only:", "\n".join(f"- {line}" for line in self.unpaired)]
        return "\n\n".join(parts)


def _table(rows: Sequence[Row]) -> str:
    cells = []
    for row in rows:
        names = row.first.problem, row.first.mode, row.first.label
        cells.append([*names, str(row.settings), text.ratio(row.ratio, 3), percent(row.noise), row.mark])
    return text.table(["problem", "mode", "method", "settings", "new / old time", "noise", "mark"], cells)


def percent(noise: float) -> str:
    """A factor above 1 as a change in per cent."""
    return f"{100 * (noise - 1):.1f} %" if math.isfinite(noise) else "unknown"


def timings(record: Record) -> Iterator[Timing]:
    """Everything that a record has times of, and unstable runs; without the loop by hand beside C, the "floor"."""
    for result in record.results:
        for p in result.points:
            errors = {f"{metric} error": error for metric, error in p.errors.items()}
            setting, uncertainty = f"{p.setting:.6g}", result.uncertainty
            yield Timing(result.name, p.mode, p.method, p.label, setting, p.seconds, errors, uncertainty)
    for table in record.article:
        for cell in table.cells:
            problem, setting, errors = f"Table {table.table.number}", f"{cell.h:g}", {"error": cell.error}
            yield Timing(problem, "pointer", cell.method, cell.label, setting, cell.seconds, errors)
    for row, columns in record.timings.items():
        problem, _, label = row.partition(", ")
        for column, seconds in ((column, seconds) for column, seconds in columns.items() if column != "floor"):
            yield Timing(f"{problem} beside C", column, label, label, "", seconds, {})


def ratio_and_noise(pairs: Sequence[tuple[Sequence[float], Sequence[float]]]) -> tuple[float, float]:
    """The ratio of the times of one method at several settings, and the factor by which it may be wrong.

    `pairs` has the seconds of the new and the old run at each setting. The ratio is the geometric mean over the
    settings of the new median over the old median.

    The runs of a round are neighbours in time, so that one disturbance hits many settings: the rounds are independent,
    but not the settings. So let x_r be the mean over the settings of the logarithm of the seconds in round r, for the
    rounds that all settings have. Its variance s^2 over the rounds is pooled from both runs. The logarithm of the ratio
    then has the variance (pi / 2) s^2 (1 / n_new + 1 / n_old): a median has pi / 2 times the variance of a mean. The
    noise is exp(t sqrt(variance)), with Student's t for `CONFIDENCE` and n_new + n_old - 2 degrees of freedom. With
    fewer than two rounds in each run it is infinite.
    """
    from scipy.special import stdtrit

    logarithm = statistics.fmean(math.log(statistics.median(a) / statistics.median(b)) for a, b in pairs)
    sides = [_rounds(side) for side in zip(*pairs, strict=True)]
    if min(map(len, sides)) < 2:
        return math.exp(logarithm), math.inf
    freedom = sum(len(side) - 1 for side in sides)
    pooled = sum((len(side) - 1) * statistics.variance(side) for side in sides) / freedom
    variance = math.pi / 2 * pooled * sum(1 / len(side) for side in sides)
    return math.exp(logarithm), math.exp(float(stdtrit(freedom, (1 + CONFIDENCE) / 2)) * math.sqrt(variance))


def _rounds(settings: Iterable[Sequence[float]]) -> list[float]:
    """The mean over the settings of the logarithm of the seconds in each round that all of them have."""
    return [statistics.fmean(map(math.log, seconds)) for seconds in zip(*settings, strict=False)]


def _rows(pairs: Sequence[tuple[Timing, Timing]]) -> Iterator[Row]:
    groups: dict[tuple[str, str, str], list[tuple[Timing, Timing]]] = {}
    for pair in pairs:
        groups.setdefault(pair[0].key[:3], []).append(pair)
    for group in groups.values():
        yield Row(group[0][0], len(group), *ratio_and_noise([(new.seconds, old.seconds) for new, old in group]))


def _changed(new: Timing, old: Timing) -> Iterator[str]:
    if bool(new.seconds) != bool(old.seconds):
        yield f"{new.words}: {_stability(new)}, before {_stability(old)}"
    if not (new.seconds and old.seconds):
        return
    for metric, error in new.errors.items():
        before = old.errors.get(metric, error)
        uncertainty = max(new.uncertainty, old.uncertainty) if metric.startswith("trajectory") else 0.0
        least = max(_ROUND_OFF, CERTAIN * uncertainty)
        if not math.isclose(max(error, least), max(before, least), rel_tol=CHANGED):
            yield f"{new.words}: {metric} {error:.3g}, before {before:.3g}"


def _stability(timing: Timing) -> str:
    return "stable" if timing.seconds else "unstable"


def _lonely(these: Mapping[tuple, Timing], others: Mapping[tuple, Timing]) -> Iterator[str]:
    """What only these have: a line for each whole problem, and for each method on a problem that both have."""
    shared = {timing.problem for timing in others.values()}
    for problem, group in groupby(these.values(), key=lambda timing: timing.problem):
        if problem not in shared:
            yield f"{problem}: all of it"
            continue
        alone = (timing for timing in group if timing.seconds and timing.key not in others)
        for _, settings in groupby(alone, key=lambda timing: timing.key[:3]):
            first, *more = settings
            yield ", ".join([first.words, *(timing.setting for timing in more)])
