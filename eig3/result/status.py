"""How a run ended."""

import enum


class Status(enum.Enum):
    """How a run ended.

    Attributes
    ----------
    COMPLETED
        The run reached the end of its span.
    DIVERGED
        The state became infinite or NaN, or the motion grew because the step is unstable.
    NOT_CONVERGED
        The solve of an implicit step did not converge.
    INTERRUPTED
        Ctrl-C, a cancellation, or an exception in a function of the user ended the run, or its process was killed.
    TERMINATED
        A terminal event ended the run, as intended.
    STEP_TOO_SMALL
        The tolerances need a step below the resolution of t.
    TOO_MANY_STEPS
        The run took `max_steps` steps before the end of its span.
    ACCURACY_NOT_REACHED
        No run reached the accuracy that was asked for; this is the best one.
    ZENO
        The times between events with `apply` became shorter than the resolution of the run, as for a ball that comes to
        rest. Or the state rests on the surface of such an event and is pushed through it, as a ball without rebound.
    """

    COMPLETED = "completed"
    DIVERGED = "diverged"
    NOT_CONVERGED = "not converged"
    INTERRUPTED = "interrupted"
    TERMINATED = "ended by an event"
    STEP_TOO_SMALL = "step too small"
    TOO_MANY_STEPS = "too many steps"
    ACCURACY_NOT_REACHED = "accuracy not reached"
    ZENO = "events without end"
