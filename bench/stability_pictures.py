"""Pictures of stability: the article's figures 1-7 and 9, and the limits under physical damping."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from eig3 import problems
from eig3.methods import METHODS, Method
from eig3.problem import Problem
from eig3.stability import damping_ratio, limit, period_error, spectral_radius, stable_region

from .choices import ARTICLE_METHODS
from .pictures import new_figure
from .stability_sets import ARTICLE_DAMPED, EIG3_SETS, FAMILY_DAMPED, UNSTABLE_SETS
from .styles import style_of

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

_OMEGA = r"$\Omega = \omega h$ (rad)"
_RADIUS = r"spectral radius $\rho$ (-)"
_DAMPING = r"algorithmic damping ratio $\bar\xi$ (-)"
_PERIOD = r"relative period error $(T_h - T)/T$ (%)"
_SET_STYLE = {
    "EIG-3(1, 1/2)": (style_of("eig3").color, "-"),
    "EIG-3(1.2, 1/2)": ("C1", "-"),
    "EIG-3(1.5, 1/2)": ("C4", "-"),
    "EIG-3(2, 1/2)": ("C5", "-"),
    "EIG-3(1.2, 0.6)": ("C0", "--"),
    "EIG-3(2, 1)": ("C2", "--"),
    "EIG-3(1, 0.6)": ("0.3", ":"),
    "EIG-3(0.8, 1/2)": ("C0", "-"),
    "EIG-3(1/2, 1/2)": ("C2", "-"),
    "EIG-3(1/3, 1/2)": ("C1", "-"),
    "EIG-3(0, 0)": ("0.3", "--"),
}
_FOUR_STEPS = (0.4, 0.49, 0.5, 0.501)  # s
_SHOWN = 20.0  # s, of a span of 1000 s
_DENSE = 400


def save(figure: Figure, path: Path) -> None:
    """Save as `path`.png and `path`.svg, the latter without the date that matplotlib writes by default."""
    figure.savefig(path.with_suffix(".png"), dpi=130)
    figure.savefig(path.with_suffix(".svg"), metadata={"Date": None})


def regions() -> Figure:
    figure = new_figure(11.5, 5.2)
    left, right = figure.subplots(1, 2)
    Omega, weight = np.linspace(0.005, 2.4, 480), np.linspace(0, 2.5, 251)
    color = style_of("eig3").color

    _region(left, Omega, weight, stable_region(Omega, weight[:, None], 0.5))
    alpha = np.linspace(1, 2.5, _DENSE)
    left.plot(np.sqrt(2 / (alpha - 0.5)), alpha, "k--", label=r"$\Omega = \sqrt{2/(\alpha - 1/2)}$")
    left.plot(2, 1, color=color, marker="o", linestyle="none", label="EIG-3(1, 1/2)")
    left.set(ylabel=r"$\alpha$ (-)", title=r"(a) $\beta = 1/2$")

    is_line = weight[:, None] == 0.5  # a row of the grid, much thicker than the line that is meant
    _region(right, Omega, weight, stable_region(Omega, 1.0, weight[:, None]) & ~is_line)
    beta = np.linspace(0, 2.5, _DENSE)
    right.plot(1 / np.sqrt(beta + 0.5), beta, "k--", label=r"$\Omega = 1/\sqrt{\beta + 1/2}$")
    beta = np.linspace(0, 0.5, _DENSE)
    right.plot(np.sqrt(2 / (1 - beta)), beta, "k:", label=r"$\Omega = \sqrt{2/(1 - \beta)}$")
    right.plot([0, 2], [0.5, 0.5], color=color, marker="o", markevery=[1], linewidth=2.5, label="EIG-3(1, 1/2)")
    right.set(ylabel=r"$\beta$ (-)", title=r"(b) $\alpha = 1$")

    for axes in (left, right):
        axes.legend(loc="upper right")
    figure.suptitle("Figure 1: where EIG-3 is stable on the undamped oscillator")
    return figure


def _region(axes: Axes, Omega: np.ndarray, weight: np.ndarray, region: np.ndarray) -> None:
    axes.contourf(Omega, weight, region, levels=[0.5, 1.5], colors=[style_of("eig3").color], alpha=0.25)
    axes.fill([], [], color=style_of("eig3").color, alpha=0.25, label="stable")
    axes.set(xlim=(0, 2.4), ylim=(0, 2.5), xlabel=_OMEGA)
    axes.grid(alpha=0.35)


def sets_radius() -> Figure:
    figure, (left, right) = _two_panels("Figure 2: spectral radius of EIG-3")
    Omega = np.linspace(0.005, 2.4, _DENSE)
    for label, method in EIG3_SETS.items():
        _set_curve(left, label, Omega, spectral_radius(method, Omega))
        left.plot(limit(method), 1, marker="o", color=_SET_STYLE[label][0])
    for label, method in UNSTABLE_SETS.items():
        _set_curve(right, label, Omega[Omega < 2], spectral_radius(method, Omega[Omega < 2]))
    left.set(xlim=(0, 2.4), ylim=(0.3, 1.6))
    right.set(xlim=(0, 2.0))
    for axes in (left, right):
        axes.set(xlabel=_OMEGA, ylabel=_RADIUS)
        axes.legend(loc="upper left")
    return figure


def _sets(title: str, function: Callable[[Method, np.ndarray], np.ndarray], ylabel: str, unit: float) -> Figure:
    """A quantity of the principal root up to the limit of each set, or up to 1 if there is no limit."""
    figure, (left, right) = _two_panels(title)
    for label, method in EIG3_SETS.items():
        Omega = _up_to(limit(method))
        _set_curve(left, label, Omega, unit * function(method, Omega))
    Omega = _up_to(1.0)
    for label, method in UNSTABLE_SETS.items():
        _set_curve(right, label, Omega, unit * function(method, Omega))
    for axes in (left, right):
        axes.set(xlabel=_OMEGA, ylabel=ylabel)
        axes.set_xlim(left=0)
        axes.legend(loc="best")
    return figure


def _two_panels(title: str) -> tuple[Figure, Any]:
    figure = new_figure(12, 5)
    panels = figure.subplots(1, 2)
    for axes, heading in zip(panels, ("sets that have a limit", "sets without a stable step"), strict=True):
        axes.set_title(heading, fontsize=11)
        axes.grid(alpha=0.35)
    figure.suptitle(f"{title} for several " + r"$(\alpha, \beta)$")
    return figure, panels


def _set_curve(axes: Axes, label: str, Omega: np.ndarray, values: np.ndarray) -> None:
    color, line = _SET_STYLE[label]
    axes.plot(Omega, values, color=color, linestyle=line, linewidth=1.8, label=label)


def _up_to(bound: float) -> np.ndarray:
    """Omega from near zero to just below a limit, since the pair of roots can become real at the limit."""
    return np.linspace(0.005, bound * (1 - 1e-6), _DENSE)


def methods_radius() -> Figure:
    figure, axes = _one_panel("Figure 5: spectral radius of the methods")
    Omega = np.linspace(0.005, 3.1, 2 * _DENSE)
    _methods(axes, lambda method, bound: (Omega, spectral_radius(method, Omega)))
    for name, method in _free_methods().items():
        if limit(method):
            style, size = style_of(name), 13 if name == "eig3" else 7
            axes.plot(limit(method), 1, marker=style.marker, color=style.color, markersize=size, zorder=3)
    axes.set(xlim=(0, 3.1), ylim=(0.4, 1.8), ylabel=_RADIUS)
    axes.legend(loc="upper left")
    return figure


def _to_limit(title: str, function: Callable[[Method, np.ndarray], np.ndarray], ylabel: str, unit: float) -> Figure:
    """A quantity of the principal root up to the limit of each method."""
    figure, axes = _one_panel(title)
    _methods(axes, lambda method, bound: (x := _up_to(bound), unit * function(method, x)))
    axes.set(xlim=(0, 3.1), ylabel=ylabel)
    axes.legend(loc="best")
    return figure


def _one_panel(title: str) -> tuple[Figure, Axes]:
    figure = new_figure(9, 5.4)
    axes = figure.subplots()
    axes.set_xlabel(_OMEGA)
    axes.grid(alpha=0.35)
    axes.set_title(title + ", undamped oscillator", fontsize=11)
    return figure, axes


def _free_methods() -> Mapping[str, Method]:
    """The article's methods for a force without velocity."""
    return {name: METHODS[name]().without_velocity() for name in ARTICLE_METHODS}


def _methods(axes: Axes, curve: Callable[[Method, float], tuple[np.ndarray, np.ndarray]]) -> None:
    """A curve for each method. CD coincides with EIG-3: its dashed line lies on a wide one."""
    lines: dict[str, dict[str, Any]] = {"eig3": {"linewidth": 4, "alpha": 0.6}, "cd": {"linestyle": "--", "zorder": 3}}
    labels = {"eig3": "EIG-3(1, 1/2)", "rk4": "RK4 (not in the article)"}
    for name, method in _free_methods().items():
        style = {"color": style_of(name).color, "linewidth": 1.8, **lines.get(name, {})}
        axes.plot(*curve(method, limit(method) or 1.0), label=labels.get(name, method.label), **style)


def four_steps() -> Figure:
    figure = new_figure(12, 7.2)
    fine = np.linspace(0, _SHOWN, 2001)
    problem = problems.single_dof()
    grid = figure.subplots(2, 2)
    for axes, h in zip(grid.flat, _FOUR_STEPS, strict=True):
        t, u = _run(problem, h)
        axes.plot(fine, np.cos(4 * fine), color="0.65", label=r"exact: $\cos \omega t$")
        axes.plot(t, u, color=style_of("eig3").color, marker="o", markersize=3.5, linewidth=1, label="EIG-3(1, 1/2)")
        rho = spectral_radius("eig3", 4 * h)
        axes.set_title(rf"$h = {h:g}$ s, $\omega h = {4 * h:g}$, $\rho = {rho:.3f}$", fontsize=11)
        axes.set(xlim=(0, _SHOWN), xlabel="time (s)", ylabel="displacement (m)")
        axes.grid(alpha=0.35)
    figure.legend(*grid[0, 0].get_legend_handles_labels(), loc="outside lower center", ncols=2)
    figure.suptitle(
        r"Figure 9: EIG-3 around its limit $h = 0.5$ s: $\omega = 4$ rad/s, $\xi = 0$, $u_0 = 1$ m, at rest"
    )
    return figure


def _run(problem: Problem, h: float) -> tuple[np.ndarray, np.ndarray]:
    n_steps = int(_SHOWN / h)
    u, v = np.empty(n_steps), np.empty(n_steps)
    problem.stepper(h=h).advance(n_steps, 1, u, v)  # not integrate, which changes h to fit the span
    return h * np.arange(n_steps + 1), np.concatenate([[problem.u0], u])


_ARTICLE_DAMPED_STYLE = {
    "EIG-3(1, 1/2)": ("eig3", "--"),
    "EIG-3(1.2, 1/2)": ("eig3", ":"),
    "CD implicit": ("cd", "--"),
    "CD lagged": ("cd", ":"),
    **{name: (name.lower(), "--") for name in ("RK2", "RK3", "RK4", "AB2", "AB3")},
}


def all_limits() -> Figure:
    """The limits of the article's methods, dashed, and of the EIG family, RK5 and RK8, in logarithms."""
    figure = new_figure(12, 6.6)
    panels = figure.subplots(1, 2)
    dampings = np.geomspace(1e-3, 2, 30)
    for case in (*ARTICLE_DAMPED, *FAMILY_DAMPED):
        if case in FAMILY_DAMPED:
            style = {"color": style_of(case.method.name).color, "linewidth": 2.2}
        else:
            name, line = _ARTICLE_DAMPED_STYLE[case.label]
            style = {"color": style_of(name).color, "linewidth": 1.2, "linestyle": line}
        limits = np.array([limit(case.method, xi) for xi in dampings.tolist()])
        panels[0].loglog(dampings, limits, label=case.label, **style)
        if case.method.evaluations:
            panels[1].loglog(dampings, limits / case.method.evaluations, **style)
    for axes, title in zip(panels, ("by step", "by evaluation of the right-hand side"), strict=True):
        axes.set(xlim=(1e-3, 2), ylim=(5e-4, 10), xlabel=r"physical damping ratio $\xi$ (-)")
        axes.set_title(title, fontsize=11)
        axes.grid(which="major", alpha=0.35)
    panels[0].set_ylabel(r"limit of $\Omega = \omega h$ (rad)")
    panels[1].set_ylabel(r"limit of $\Omega$ by evaluations per step (rad)")
    figure.legend(*panels[0].get_legend_handles_labels(), loc="outside right center")
    figure.suptitle("Stability limits of all methods; thin lines: methods of the article")
    return figure


_ENDS = "A curve ends at the limit, or earlier where the principal pair of roots becomes real"

#: The name of each picture, the function that draws it, and its caption.
PICTURES: dict[str, tuple[Callable[[], Figure], str]] = {
    "figure1": (
        regions,
        "Figure 1. Where EIG-3 is stable, undamped. (a) beta = 1/2: from alpha = 1 upwards. (b) alpha = 1: above "
        "beta = 1/2 up to 1/sqrt(beta + 1/2); on the line beta = 1/2 up to 2; below the line only between two limits, "
        "so that no small step is stable.",
    ),
    "figure2": (
        sets_radius,
        "Figure 2. Spectral radius of EIG-3; dots mark the limits. On the left only (1, 1/2) keeps the radius 1 up to "
        "its limit; the sets on the right exceed 1 at every step.",
    ),
    "figure3": (
        partial(_sets, "Figure 3: algorithmic damping ratio of EIG-3", damping_ratio, _DAMPING, 1.0),
        f"Figure 3. Algorithmic damping ratio of EIG-3. {_ENDS}; on the right, where there is no limit, at "
        "Omega = 1. A negative ratio is growth.",
    ),
    "figure4": (
        partial(_sets, "Figure 4: relative period error of EIG-3", period_error, _PERIOD, 100.0),
        f"Figure 4. Relative period error of EIG-3. {_ENDS}; on the right at Omega = 1.",
    ),
    "figure5": (
        methods_radius,
        "Figure 5. Spectral radius of the methods; markers show the limits. EIG-3(1, 1/2) and CD coincide. RK2 and "
        "AB2 exceed 1 at every step.",
    ),
    "figure6": (
        partial(_to_limit, "Figure 6: algorithmic damping ratio of the methods", damping_ratio, _DAMPING, 1.0),
        f"Figure 6. Algorithmic damping ratio of the methods. {_ENDS}; RK2 and AB2, without a limit, are shown to "
        "Omega = 1: their ratio is negative, so their solutions grow.",
    ),
    "figure7": (
        partial(_to_limit, "Figure 7: relative period error of the methods", period_error, _PERIOD, 100.0),
        f"Figure 7. Relative period error of the methods. {_ENDS}; RK2 and AB2 at Omega = 1.",
    ),
    "figure9": (
        four_steps,
        "Figure 9. The single degree of freedom of section 4.1 by EIG-3 with four steps around its limit. At h = 0.5 s "
        "both roots are -1, and a disturbance grows in proportion to time. This run has no disturbance, since every "
        "number in it is exact in binary.",
    ),
    "all_limits": (
        all_limits,
        "Not in the article: the limits of all methods under physical damping. By evaluation, RK8 is stable up to "
        "0.5, and the grades above 6 are below that from xi = 0.06 on. The limits of EIG-6 and RK5 fall with weak "
        "damping, which then no longer stops their weak growth. CD implicit needs a solve and is left out on the "
        "right.",
    ),
}
