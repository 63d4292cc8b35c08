"""A building of three storeys in an earthquake."""

from functools import partial

import numpy as np

from eig3 import drawing
from eig3.animation import Mechanism
from eig3.effects import LinearDamper, LinearSpring, SampledMotion
from eig3.problem import Problem
from eig3.result.memory import record_places
from eig3.scene import Scene

MAGNIFIED = 40  # displacements in animations
STOREY, WIDTH = 3.0, 6.0  # in animations, m
_BYTES = 200  # of the arrays for a sample of a record, while it is made


def shaking(duration: float, spacing: float, peak: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return a record similar to an earthquake record: times, s, and accelerations of the ground, m/s^2.

    It is white noise through the filter of Kanai and Tajimi for firm ground (15 rad/s, damping 0.6). The envelope rises
    during an eighth of the duration and falls from half of it.
    """
    if not (isinstance(seed, int | np.integer) and seed >= 0):
        raise ValueError(f"record must be a whole number of at least 0, not {seed!r}.")
    rng = np.random.default_rng(seed)
    t = record_places(duration, spacing, each=_BYTES)
    ratio = 2 * np.pi * np.fft.rfftfreq(2 * t.size, spacing) / 15.0
    ground = (1 + 1.2j * ratio) / (1 - ratio**2 + 1.2j * ratio)
    noise = np.fft.irfft(ground * np.fft.rfft(rng.standard_normal(2 * t.size)))[: t.size]
    share = t / duration
    a = noise * np.minimum(1, 8 * share) ** 2 * np.exp(-6 * np.maximum(0, share - 0.5))
    return t, a * peak / np.abs(a).max()


def quake(duration: float, spacing: float, peak: float, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return the displacements of the ground, m, of such a record, and their times, s.

    The accelerations are integrated twice, without the part below some 0.2 Hz, as is usual for measured records.
    """
    t, a = shaking(duration, spacing, peak, seed)
    omega = 2 * np.pi * np.fft.rfftfreq(2 * t.size, spacing)
    slow = (omega / (2 * np.pi * 0.2)) ** 4
    twice = np.zeros_like(omega)
    twice[1:] = -slow[1:] / (1 + slow[1:]) / omega[1:] ** 2
    x = np.fft.irfft(twice * np.fft.rfft(a, 2 * t.size))[: t.size]
    return t, (x - x[0]) * np.minimum(1, t)


def shear_building(
    m: float = 20e3,
    stiffness: float = 12e6,
    damping: float = 60e3,
    peak: float = 3.0,
    record: int = 1906,
    t_end: float = 30.0,
    work: bool = False,
) -> Problem:
    """Three rigid floors on columns that shear, on ground that moves as a record; u has the floors' displacements.

    Parameters
    ----------
    m : float
        Mass of a floor, kg.
    stiffness : float
        Stiffness of the columns of a storey, N/m. With the defaults the periods are 0.58, 0.21 and 0.14 s.
    damping : float
        Damping of a storey, N s/m.
    peak : float
        Largest acceleration of the ground, before the slow part is removed, m/s^2.
    record : int
        The seed of the record, at least 0: each number is another motion of the ground.
    t_end : float
        Duration, s.
    work : bool
        Follow the work done by the ground and the dampers.
    """
    t, x = quake(max(t_end, 10.0), 0.01, peak, record)
    scene = Scene(dimension=1)
    ground = scene.fixed(0.0)
    floors = scene.mass(m, np.zeros(3))
    for below, above in ((ground, floors[0]), (floors[0], floors[1]), (floors[1], floors[2])):
        scene.add(LinearSpring(stiffness), below, above)
        scene.add(LinearDamper(damping), below, above)
    scene.add(SampledMotion(t, x), ground)

    return scene.problem((0.0, t_end), name="shear_building", work=work).with_(
        source="the shear building of structural dynamics; record: Kanai (1957) and Tajimi (1960)",
        h=1e-4,
        draw=partial(draw, times=t, ground=x),
        view=view_of_buildings([(0.0, 0.5)], t, x),
    )


def view_of_buildings(walls, times, ground):
    """Return the view of buildings of three storeys with magnified displacements.

    Parameters
    ----------
    walls : sequence of (float, float)
        For each building, the place of its wall at rest, m, and the part of its width that is to the right of the wall.
    times, ground : ndarray
        The record of the ground.
    """
    frame = [(k, k + 1) for k in range(0, 8, 2)] + [(k, k + 2) for k in range(6)]  # floors, then columns
    corners = 8 * np.arange(len(walls))
    return Mechanism(
        partial(corners_of_floors, walls=walls, times=times, ground=ground),
        links=np.concatenate([np.array(frame) + first for first in corners]),
        fixed=np.concatenate([corners, corners + 1]),
        planes=[((0.0, 1.0), 0.0)],
        labels=("", "height (m)"),
        note=f"horizontal displacements {MAGNIFIED} times as large",
    )


def corners_of_floors(t, u, walls, times, ground):
    """Return the left and the right end of the ground and of each floor, building by building."""
    base = np.interp(t, times, ground)
    height = np.repeat(np.arange(4) * STOREY, 2)
    found = []
    for k, (wall, right) in enumerate(walls):
        levels = np.column_stack([base + wall, u[:, 3 * k : 3 * k + 3]])
        ends = MAGNIFIED * levels[:, :, None] + WIDTH * np.array([right - 1, right])
        x = ends.reshape(len(t), 8)
        found.append(np.stack([x, np.broadcast_to(height, x.shape)], axis=-1))
    return np.concatenate(found, axis=1)


def draw(figure, solution, times, ground):
    u = 1e3 * np.column_stack([np.interp(solution.t, times, ground), solution.u])
    names = ["ground", "third floor"]
    drawing.lines(drawing.time_panel(figure, "displacement (mm)"), solution.t, u[:, [0, 3]], names)
    names = ["storey 1", "storey 2", "storey 3"]
    drawing.lines(drawing.time_panel(figure, "drift of the storey\n(mm)"), solution.t, np.diff(u), names)
