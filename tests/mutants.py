"""Small mistakes that a test must notice: `python tests/mutants.py [WORD ...]` makes those with one of the words.

Each is made in a copy of the project, and the tests that reach the place run there. Those that no test notices are
printed. Code that is compiled gets a cache of its own: a cache of the disk does not see changes of functions that a
function calls.
"""

import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).parent.parent
PLAIN = ("eig3/fitting", "eig3/diagnosis", "eig3/ensembles")  # none of which is compiled

#: What stands in a file before and after a mistake, for each file and the tests that notice it.
MUTANTS = {
    # First-order unknowns and links with memory
    ("eig3/functions/first_order.py", "test_first_order.py -k 'order or names_shapes or bits or other_starts'"): [
        ('[:n_own]", f"{v}[:n_own]', '[:n_own]", f"{v}[n_own:]'),
        ("    n_own = {u}.size - {self.size}", "    n_own = {u}.size - {self.size} - 1"),
        ("u.shape[-1] - self.size, {}", "u.shape[-1] - len(self.names), {}"),
    ],
    ("eig3/stepping/tolerances.py", "test_first_order.py -k 'tolerances or atol or unit or constant_unknown'"): [
        ("        atol[0, n:] = np.inf\n", ""),
        ("n + n_first_order * are_read", "n"),
    ],
    ("kernels/loops/variable.py", "test_first_order.py -k the_unit_of_z"): [
        ("if span.atol[0, j] < math.inf and", "if span.atol[1, j] < math.inf and"),
    ],
    ("eig3/result/solution.py", "test_first_order.py -k 'events_read_z or saved_states'"): [
        ("flat(jump.z_after, len(jump))", "flat(jump.z, len(jump))"),
        ("evaluate(t, *_with_z(u, v, z, 0.0))", "evaluate(t, *_with_z(u, v, 0 * z, 0.0))"),
    ],
    ("eig3/effects/elastic_plastic.py", "test_memory.py -k 'step_response or iwan or order or dissipates'"): [
        ("crossing = 1", "crossing = -1"),
        ("return -rate if", "return rate if"),
        ("(1 - INSIDE) * yield_force\n    tension", "0.98 * yield_force\n    tension"),
    ],
    ("eig3/effects/elastic_plastic.py", "test_memory.py -k 'opensees or isotropic or shake_down'"): [
        ("(1 - hardening) * yield_force\n    return min", "yield_force\n    return min"),
        ("(1 - isotropic) * modulus * plastic", "modulus * plastic"),
        ("isotropic * modulus * accumulated", "isotropic * modulus * abs(plastic)"),
        ("/ (stiffness + modulus)", "/ stiffness"),
    ],
    ("eig3/effects/bouc_wen.py", "test_memory.py -k 'bouc_wen or opensees'"): [
        ("(1 - hardening) * state", "state"),
        ("(pinching if rate * state > 0", "(pinching if rate * state < 0"),
        ("exp(sharpness * log(abs(state", "exp(log(abs(state"),
    ],
    ("eig3/effects/maxwell.py", "test_memory.py -k 'standard_linear or opensees'"): [
        ("stiffness / damping * state", "1.02 * stiffness / damping * state"),
    ],
    ("eig3/structures/links.py", "test_structure_links.py"): [
        ('_signed(kind, ends, "+=", "-="):', '_signed(kind, ends, "+=", "+="):'),
        ("total {sign} p.influence", "total += p.influence"),
    ],
    ("eig3/scene/assembly.py", "test_memory.py -k numbers_by_their_effect"): [
        ("            firsts[title] += effect.state_size * size\n", ""),
    ],
    # Kernels
    ("kernels/loops/march.py", "test_kernels.py -k ab3_starts_with_kutta"): [
        ("START_STEPS > 0 and i < started:", "START_STEPS > 0 and i <= started:"),
        ("(START_COST - COST) * ((i if i < started else started) - first)", "(START_COST - COST) * (i - first)"),
    ],
    ("kernels/loops/march.py", "test_divergence.py -k slow_growth_is_noted"): [
        ("counters[PART_END] < last:", "counters[PART_END] < 0:"),
    ],
    ("kernels/loops/march.py", "test_outputs.py -k of_an_oscillation"): [("if e < low:", "if e <= low:")],
    ("kernels/loops/observe.py", "test_extremes.py -k right_after_an_impact"): [
        ("            follow_end(follow, look.within)\n", ""),
        ("span.every == 1 and s > 0", "s > 0"),
    ],
    ("kernels/loops/observe.py", "test_divergence.py -k starts_from_nothing"): [
        ("    end_part(follow, counters, i, n, v_now)\n", ""),
    ],
    ("kernels/neighbours.py", "test_neighbours.py -k half_of_its_skin"): [
        ("+ skin)) / 2", "+ skin)) / 1.6"),
        ("+ skin)) / 2", "+ skin)) / 2.2"),
        ("square += way * way", "square = way * way"),
    ],
    ("kernels/neighbours.py", "test_periodic_box.py -k follows_the_flow"): [
        ("(skin - abs(strain)", "(skin + abs(strain)")
    ],
    ("kernels/loops/controller.py", "test_tolerances.py -k gustafsson"): [
        ("- 0.7 * now", "- 0.6 * now"),
        ("0.4 * last", "0.3 * last"),
        ("order > 3 and", "order >= 3 and"),
        ("last - 2 * now", "last - now"),
        ("= 0.9, 0.2, 10.0", "= 0.85, 0.2, 10.0"),
        ("= 0.9, 0.2, 10.0", "= 0.9, 0.95, 10.0"),
        ("0.3465553856 *", "0.3 *"),
        ("0.6565 + 0.3435", "0.6 + 0.3435"),
    ],
    ("kernels/loops/dense.py", "test_t_eval.py -k order_of_the_dense"): [
        ("(3 * a[j] - a_b[j])", "(3 * a[j] + a_b[j])"),
        ("8 * v[j] + 7 * v_b[j]", "7 * v[j] + 8 * v_b[j]"),
        ("4 * c4 / h", "3 * c4 / h"),
    ],
    ("kernels/methods/rk4.py", "test_kernels.py -k step_is_the_matrix_of"): [
        ("h * h / 4 * a1", "h * h / 2 * a1"),
        ("2 * a2[j] + 2 * a3[j]", "2 * a2[j] + a3[j]"),
    ],
    ("kernels/methods/rk4.py", "test_order.py -k 'damped_forced and RK4'"): [("f(t + h, u_stage", "f(t, u_stage")],
    ("kernels/methods/ab3.py", "test_kernels.py -k step_is_the_matrix_of"): [
        ("5 * a2[j] - 16 * a1[j]", "5 * a2[j] - 15 * a1[j]"),
        ("16 * v1[j] + 5 * v2[j]", "16 * v1[j] + 4 * v2[j]"),
    ],
    ("kernels/methods/cd.py", "test_kernels.py -k lagged_central_difference"): [
        ("w[j] + h / 2 * a[j]", "w[j] + h * a[j]"),
        ("return v - h / 2 * a, a", "return v + h / 2 * a, a"),
    ],
    ("kernels/methods/eig.py", "test_family.py -k 'coefficients_are or velocities_are'"): [
        ("i in range(1, k + 1)", "i in range(1, k)"),
        ("(shift + i) * high", "(shift - i) * high"),
        ("_weighted_integral(j, -1)", "_weighted_integral(j, 0)"),
        ("x / (k + 1) for k", "x / (k + 2) for k"),
    ],
    ("kernels/methods/eig3_variable.py", "test_tolerances.py -k velocity_verlet"): [
        ("h * (a0[j] + rise / 2)", "h * (a0[j] + rise / 3)"),
        ("rise = {out.before} / h *", "rise = h / {out.before} *"),
        ("(h * h / 6) ** 2 *", "(h * h / 5) ** 2 *"),
    ],
    ("kernels/methods/langevin.py", "test_langevin.py -k steps_are_those"): [
        ("-2 * settings[GAMMA]", "-settings[GAMMA]"),
        ("middle + half * v[k]", "middle + half * kicked"),
    ],
    ("kernels/philox.py", "test_noise.py -k 'bits_are or normal_and'"): [
        ("(a_0 * b_1 + (middle & _LOW))", "(a_0 * b_1 + middle)"),
        ("sqrt(-2.0 * log", "sqrt(-1.9 * log"),
    ],
    ("eig3/scene/hinge_friction.py", "test_bodies.py -k is_a_couple"): [
        ("regularization_speed) + damping)", "regularization_speed) - damping)"),
        ("limit / math.sqrt", "2 * limit / math.sqrt"),
    ],
    ("kernels/vector_angle.py", "test_bodies.py -k is_a_couple"): [
        ("axis[1] * (mine[1] - theirs[1])", "axis[1] * (mine[1] + theirs[1])"),
        ("(torque * g[1], -torque * g[0])", "(-torque * g[1], torque * g[0])"),
    ],
    ("kernels/grains.py", "test_grains.py -k 'at_most_mu or then_rolls'"): [
        ("part = limit / math.sqrt(square)", "part = 1.1 * limit / math.sqrt(square)"),
        ("square <= limit * limit", "square <= 2 * limit * limit"),
    ],
    # Effects
    ("eig3/effects/hertz_mindlin.py", "test_grains.py -k 'then_rolls or have_the_restitution'"): [
        ("push = 4 / 3 * plane", "push = 1.36 * plane"),
        ("self.E / (2 * (1 - self.nu**2))", "self.E / (2 * (1 - self.nu))"),
        ("_LOSS = 2 * math.sqrt(5 / 6)", "_LOSS = 2 * math.sqrt(4 / 6)"),
    ],
    ("eig3/effects/hertz_mindlin.py", "test_grains.py -k mindlins_part"): [
        ("return 8 * shear_modulus", "return 7.5 * shear_modulus"),
        ("4 * (2 - self.nu) * (1 + self.nu)", "4 * (2 - self.nu)"),
        ("loss * math.sqrt(8 * shear_modulus", "loss * math.sqrt(4 * shear_modulus"),
    ],
    ("eig3/effects/hertz.py", "test_effects.py -k 'contact'"): [
        ("return 2 / 5 *", "return 1 / 2 *"),
        ("1 + damping * rate", "1 - damping * rate"),
    ],
    ("eig3/effects/hardening_spring.py", "test_effects.py -k 'gradient and hardening'"): [
        ("cubic / 2 * square", "cubic / 3 * square")
    ],
    ("eig3/effects/softening_spring.py", "test_effects.py -k 'gradient and softening'"): [
        ("stiffness * saturation * tanh", "stiffness * tanh")
    ],
    ("eig3/effects/lennard_jones.py", "test_effects.py -k 'gradient and Lennard'"): [
        ("24 * epsilon", "23 * epsilon"),
        ("1 - 2 * s6", "1 - s6"),
    ],
    ("eig3/effects/coulomb.py", "test_effects.py -k 'gradient and Coulomb'"): [
        ("2 / math.sqrt(math.pi) * alpha", "1 / math.sqrt(math.pi) * alpha"),
        ("return prefactor / r\n", "return prefactor * r\n"),
    ],
    ("eig3/effects/charges.py", "test_mixtures.py -k ewalds"): [
        ("2 / math.sqrt(math.pi) * alpha", "1 / math.sqrt(math.pi) * alpha"),
    ],
    ("kernels/ewald.py", "test_mixtures.py -k ewalds"): [
        ("re * others[e] - im * ones[e]", "re * others[e] + im * ones[e]"),
        ("sign_y * ys[BATCH + e]", "ys[BATCH + e]"),
    ],
    ("eig3/scene/pair_force.py", "test_mixtures.py -k ones_own"): [
        ('"geometric": (np.sqrt, "*")', '"geometric": (np.sqrt, "+")'),
    ],
    ("eig3/effects/shifted.py", "test_effects.py -k 'gradient and Coulomb'"): [
        ("- (r - cutoff) * pull", "+ (r - cutoff) * pull")
    ],
    ("eig3/effects/morse.py", "test_effects.py -k 'gradient and Morse'"): [
        ("near * (1 - near)", "near * (1 - 2 * near)")
    ],
    ("eig3/effects/cable.py", "test_scene_events.py -k 'taut_and_slack'"): [
        ("min(0.0, damping * rate)", "damping * rate")
    ],
    ("eig3/effects/coulomb_friction.py", "test_effects.py -k friction_at_high_speed"): [
        ("scale(-dot(normal, v), normal)", "scale(dot(normal, v), normal)"),
        ("scale(-mu * normal_force", "scale(-0.9 * mu * normal_force"),
    ],
    ("eig3/effects/rotating_frame.py", "test_effects.py -k 'straight_line and 2'"): [
        ("scale(2.0, cross", "scale(1.9, cross")
    ],
    ("eig3/effects/isotropic.py", "test_cells.py -k 'elastic_constants or plane_stress'"): [
        ("(1 - 2 * nu)), E", "(1 - nu)), E"),
        ("E / (2 * (1 + nu))", "E / (2 * (1 - nu))"),
    ],
    ("eig3/effects/neo_hookean.py", "test_cells.py -k 'gradient or elastic_constants'"): [
        ("first / 2 * log", "first * log"),
        ("first * math.log(J) - shear", "first * math.log(J) + shear"),
    ],
    ("eig3/effects/wind_pressure.py", "test_cells.py -k wind_pushes"): [
        ("(12 * length", "(6 * length"),
        ("along * abs(along)", "along * along"),
    ],
    ("eig3/effects/ryckaert_bellemans.py", "test_cells.py -k 'gradient'"): [("3 * c[3]", "2 * c[3]")],
    # Structures
    ("eig3/structures/damping.py", "test_linear.py -k damping_ratios"): [
        ("return float(a), float(b)", "return float(a), 0.9 * float(b)"),
        ("return float(a), float(b)", "return 0.9 * float(a), float(b)"),
        ("rates = 2 * np.broadcast", "rates = np.broadcast"),
    ],
    ("eig3/structures/modes.py", "test_linear.py -k modes_of_a_large"): [
        ("return np.sqrt(np.where(", "return np.abs(np.where(")
    ],
    ("eig3/structures/matrices.py", "test_linear.py -k lumped_masses"): [
        ("(total / of_diagonal)[part]", "(of_diagonal / total)[part]")
    ],
    ("eig3/structures/frame_members.py", "test_frame.py -k 'cantilever or hinges'"): [
        ("length**2 / 24", "length**2 / 12"),
        ("4 * length**2", "4.2 * length**2"),
    ],
    # Fitting
    ("eig3/fitting/estimates.py", "test_fitting.py -k standard_errors"): [
        ("= variance * (scaled", "= 1.1 * variance * (scaled"),
        ("= variance * (scaled", "= 1.4 * variance * (scaled"),
    ],
    ("eig3/fitting/estimates.py", "test_fitting.py -k do_not_determine"): [
        ("> _INVOLVED)", "< _INVOLVED)"),
        ("s <= _DEPENDENT * s[0]", "s < 0"),
    ],
    ("eig3/fitting/fit.py", "test_fitting.py -k 'standard_errors or at_a_bound'"): [
        ("1.0 if has_sigma else scatter**2", "1.0 if has_sigma else scatter"),
        ("residuals @ residuals / freedom", "residuals @ residuals / (freedom + 1)"),
        ("& (gradient > 0)", "& (gradient < 0)"),
        ("high - x <= _AT_BOUND", "high - x >= _AT_BOUND"),
    ],
    ("eig3/fitting/fit.py", "test_fitting.py -k bad_arguments_of_a_fit"): [
        ("len(model) < n_free + (sigma is None):", "len(model) < n_free:"),
        ("first < begin or last > end", "last > end"),
    ],
    ("eig3/fitting/stencils.py", "test_fitting.py -k 'degree_4 or errors_are_bounds or size_of_the_value'"): [
        ("1 / 12, -8 / 12", "1 / 11, -8 / 12"),
        ("_SPREAD = 1 / 4,", "_SPREAD = 1 / 2,"),
        ("_RELATIVE = 2.0**-12", "_RELATIVE = 2.0**-8"),
        ("np.floor(np.log2(steps))", "np.ceil(np.log2(steps))"),
        ("spread + round_off, axis", "round_off, axis"),
        ("_UNIT * math.sqrt(n_steps)", "0.1 * _UNIT * math.sqrt(n_steps)"),
    ],
    ("eig3/result/resampling.py", "test_fitting.py -k degree_5"): [
        ("- count // 2, 0", "- count // 2, 1"),
        ("_COUNT = 6", "_COUNT = 5"),
    ],
    # Diagnosis
    ("eig3/diagnosis/stiffness.py", "test_stiffness.py -k within_its_period"): [
        ("_DAMPED = 0.7", "_DAMPED = 0.2"),
        ("_GROWTH = 1.1", "_GROWTH = 5"),
        ("_LONGER = 1.25", "_LONGER = 1.0"),
        ("_MOST * len(looked)", "0.1 * len(looked)"),
    ],
    ("eig3/diagnosis/coarseness.py", "test_coarseness.py"): [
        ("(bends / spread) ** 0.25 / 2", "(bends / spread) ** 0.25 / 1.8"),
        ("_FEW, _FEW_OF_HIGH_ORDER = 6, 3", "_FEW, _FEW_OF_HIGH_ORDER = 8, 3"),
        ("_FEW, _FEW_OF_HIGH_ORDER = 6, 3", "_FEW, _FEW_OF_HIGH_ORDER = 6, 5"),
        ("theta > _most(stepper.method) else", "theta < _most(stepper.method) else"),
        ("2 * _OVERDAMPED * limit", "_OVERDAMPED * limit"),
        ("v + h / 2 * a), v", "v - h / 2 * a), v"),
        ("_SUFFICIENT = 20", "_SUFFICIENT = 10"),
    ],
    ("eig3/result/error_estimate.py", "test_check.py"): [
        ("_BELOW = 0.6", "_BELOW = 3.6"),
        ("_ROUND_OFF = 1e-12", "_ROUND_OFF = 1e-16"),
        ("_LEAST_RATIO = 2.0", "_LEAST_RATIO = 20.0"),
        ("_NO_DIGIT = 0.5", "_NO_DIGIT = 0.05"),
        ("_CONVERGING = 0.2", "_CONVERGING = 20.0"),
        ("_FEW_MORE = 0.3", "_FEW_MORE = 3.0"),
        ("(c**middle - 1)", "(c**middle + 1)"),
        ("1 / (1 - fine.ratio **", "1 / (1 + fine.ratio **"),
    ],
    (
        "eig3/diagnosis/divergence.py",
        "test_divergence.py -k 'linear_run_names or hardening_names or unbounded_itself'",
    ): [("_SAFETY = 0.9", "_SAFETY = 1.1")],
    (
        "eig3/diagnosis/critical.py",
        "test_critical.py -k 'test_oscillator or saddle or free_particle or pure_drag'",
    ): [
        ("safety * limit, omega", "limit, omega"),
        ("c * c / 4 - k", "c * c / 2 - k"),
    ],
    # Ensembles
    ("eig3/ensembles/members.py", "test_ensemble.py -k 'own_step or last_time or broadcast or refused_in'"): [
        ("np.ceil(ratio)", "np.floor(ratio)"),
        ("np.isfinite(h) & (h > 0)", "np.isfinite(h) & (h >= 0)"),
        ("array.ndim > inner + 1:", "array.ndim > inner + 2:"),
    ],
    ("eig3/ensembles/block.py", "test_ensemble.py -k 'growth_from_rest or finite_but_grows or diverges_ends'"): [
        ("return u_grown | v_grown | (", "return ("),
        ("self._ends // 2", "self._ends // 20"),
    ],
    ("eig3/ensembles/histories.py", "test_ensemble.py -k 'events_that_end or own_step or last_time'"): [
        ("(index % self.every > 0) | (t", "(index % self.every > 1) | (t"),
        ("> 0) | (t > grid)", "> 0) | (t >= grid)"),
        ("np.arange(rows) > last]", "np.arange(rows) >= last]"),
        ("np.arange(rows) == last]", "np.arange(rows) > last]"),
        ("values[later], values[places, last] = np.nan, end", "values[later], values[places, 0] = np.nan, end"),
    ],
    ("kernels/loops/lane_search.py", "test_lane_events.py -k 'two_degrees or one_degree or stays_at_its_zero'"): [
        ("unit * pair[V_END][j]", "pair[V_END][j]"),
        ("watch.t0 + (i - 1) * h, t", "watch.t0 + i * h, t"),
        ("side if side != 0 else math.nan", "side"),
    ],
    (
        "eig3/ensembles/adaptive_observer.py",
        "test_adaptive_lanes.py -k 'events_and or lanes_leave or quantities_and'",
    ): [
        ("numbers[~reached]] = np.nan", "numbers[reached]] = np.nan"),
        ("numbers[member[valid]], found[valid]", "numbers[member], found"),
        ("np.maximum(first - low, high - first)", "np.maximum(low - first, high - first)"),
        ("order = order[reached[saved[0][order]]]", "order = order[:]"),
    ],
    ("kernels/lane_observation.py", "test_adaptive_lanes.py -k 'events_and or quantities_and'"): [
        ("row = m * len(watch.times)", "row = 0 * len(watch.times)"),
        ("float(taken - taken % every + every)", "float(taken + every)"),
        ("for k in (A, A_END):", "for k in (A,):"),
    ],
    ("eig3/ensembles/histories.py", "test_adaptive_lanes.py -k 'steps_of_single_runs'"): [
        ("/ np.maximum(1, n_steps)", "/ np.maximum(1, n_steps + n_rejected)"),
        (
            "n_steps, n_rhs)\n        self.n_rejected[chosen] = n_rejected",
            "n_rejected, n_rhs)\n        self.n_rejected[chosen] = n_steps",
        ),
    ],
    ("eig3/ensembles/occurrences.py", "test_adaptive_lanes.py -k 'events_and_times'"): [
        ("first[member[::-1]] = t[::-1]", "first[member] = t"),
        ("[i, i + 1]", "[i, i + 2]"),
    ],
    ("eig3/ensembles/parts.py", "test_parts.py -k 'division_depends'"): [
        ("(_PARTS * _UNIT))", "(2 * _PARTS * _UNIT))")
    ],
    ("eig3/ensembles/solution.py", "test_ensemble.py -k 'members_are_solutions'"): [
        ("not -len(self) <= i < len(self)", "not -len(self) <= i <= len(self)")
    ],
}

#: What no test can notice: a file, what stands there before and after, and why.
EQUIVALENT = [
    (
        "eig3/ensembles/adaptive_observer.py",
        "np.ones((count, lanes)),\n            np.ones",
        "np.zeros((count, lanes)),\n            np.ones",
        "a member that begins in a lane sets its sides",
    ),
    (
        "kernels/loops/march.py",
        "is_complete = START_STEPS > 0 and i <= started",
        "is_complete = False",
        "in a step of the starter, the velocity and the mean velocity give each other, to round-off",
    ),
    ("kernels/neighbours.py", "limit >= 0 and", "limit > 0 and", "a new list has the forces of the old one"),
    ("kernels/neighbours.py", "BATCH = 192", "BATCH = 96", "a pair has the same bits at each place of a batch"),
    ("kernels/grains.py", "square <= limit", "square < limit", "at the limit, a force is shortened by the factor 1"),
    ("kernels/elementary.py", "_TANH_IS_1 = 22.0", "_TANH_IS_1 = 23.0", "tanh is rounded to 1 from 19.1 on"),
    ("kernels/philox.py", "_11) + 1.0)", "_11) + 2.0)", "a change of 2^-53, the least distance of two numbers"),
    ("eig3/effects/restitution.py", "rate >= 0", "rate > 0", "the rate 0 rebounds with the rate 0"),
    ("eig3/effects/shifted.py", "- pull_at_cutoff if r <", "- pull_at_cutoff if r <=", "both are 0 at the cutoff"),
]


def main(words: list[str]) -> int:
    unnoticed = 0
    with tempfile.TemporaryDirectory() as folder:
        copy = copied(Path(folder) / "project")
        for (name, tests), changes in MUTANTS.items():
            for before, after in changes:
                if not words or any(word in f"{name} {tests} {before} {after}" for word in words):
                    found = outcome(copy, name, tests, before, after)
                    unnoticed += found != "noticed"
                    print(f"{found}: {name}: {before!r} -> {after!r} ({tests})", flush=True)
    for name, before, after, why in EQUIVALENT:
        print(f"equivalent: {name}: {before!r} -> {after!r}: {why}")
    print(f"{unnoticed} not noticed")
    return unnoticed > 0


def copied(copy: Path) -> Path:
    """Copy the project into a folder from which Python imports it."""
    files = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True).stdout.split("\n")
    for name in filter(None, files):
        (copy / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy2(ROOT / name, copy / name)
    for name in ("kernels", "problems", "bench"):
        (copy / "eig3" / name).symlink_to(copy / name)
    return copy


def outcome(copy: Path, name: str, tests: str, before: str, after: str) -> str:
    """Return what the tests say about a mistake."""
    file, cache = copy / name, copy / ("cache" if name.startswith(PLAIN) else "own cache")
    text = file.read_text()
    if text.count(before) != 1:
        return f"found {text.count(before)} times"
    command = [sys.executable, "-m", "pytest", "-q", "-x", "-p", "no:cacheprovider", *shlex.split(f"tests/{tests}")]
    try:
        file.write_text(text.replace(before, after))
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(cache), "PYTHONDONTWRITEBYTECODE": "1"}
        run = subprocess.run(command, cwd=copy, env=environment, capture_output=True, text=True)
    finally:
        file.write_text(text)
        shutil.rmtree(copy / "own cache", ignore_errors=True)
    return {0: "NOT NOTICED", 1: "noticed"}.get(run.returncode, run.stdout[-1000:])


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
