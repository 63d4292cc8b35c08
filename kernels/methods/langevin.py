"""BAOAB for u'' = f(t, u) - gamma v + noise, whose distribution has the temperature T: Leimkuhler and Matthews (2013).

B:  v += h/2 f(t, u)        A:  u += h/2 v        O:  v = e^(-gamma h) v + sqrt(T/m (1 - e^(-2 gamma h))) R

A step is B A O A B, with a normal random number R for each degree of freedom. The last f is the first of the next step.
The part O is exact. Without friction and noise, the method is velocity Verlet.

R depends on the seed, the stream, the step index and the degree of freedom only. A block of trajectories has a stream
for each of its `lanes`, and value j of the trajectory in a lane is at index j * lanes + lane.

B. Leimkuhler and C. Matthews, Rational construction of stochastic numerical methods for molecular sampling, Applied
Mathematics Research eXpress 2013(1), 34-56.
"""

import math

import numpy as np

from ..compile.jit import element
from ..philox import normal

PAST, ROWS, EVALUATIONS = 1, 3, 1

#: The places of the settings. After the streams of the lanes comes sqrt(1/m): one value, or one a degree of freedom.
GAMMA, TEMPERATURE, SEED, LANES, STREAMS = range(5)

KIND = np.uint64(1)  # the numbers of `eig3.noise` are of another kind, so that a force can have the same seed


@element
def constants(settings, h, work):
    decay = math.exp(-settings[GAMMA] * h)
    return decay, math.sqrt(settings[TEMPERATURE] * -math.expm1(-2 * settings[GAMMA] * h)), settings


@element
def step(f, at, y, c, n):
    u, v, a = y
    half, (decay, spread, settings) = at.h / 2, c
    seed, count, lanes = np.uint64(settings[SEED]), np.uint64(at.i), int(settings[LANES])
    weights = STREAMS + lanes
    stride = 1 if len(settings) > weights + 1 else 0
    for j in range(n // lanes):
        amplitude = spread * settings[weights + j * stride]
        for lane in range(lanes):
            k = j * lanes + lane
            kicked = v[k] + half * a[k]
            middle = u[k] + half * kicked
            random = normal(seed, np.uint64(settings[STREAMS + lane]), count, np.uint64(j), KIND)
            v[k] = decay * kicked + amplitude * random
            u[k] = middle + half * v[k]
    f(at.t + at.h, u, v, at.p, a)
    for k in range(n):
        v[k] += half * a[k]
    return y, True


def start(u, v, a, h):
    return (a,)
