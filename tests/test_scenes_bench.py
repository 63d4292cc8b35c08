"""`eig3 bench scenes`: scenes and systems by hand are the same systems, and the tables are complete."""

import numpy as np
import pytest

from eig3 import effects
from eig3.bench import scene_pairs, scenes

from .conftest import acceleration

pytestmark = pytest.mark.system


@pytest.mark.parametrize("pair", scene_pairs.SCENE_PAIRS, ids=lambda pair: pair.title)
def test_a_scene_and_the_system_by_hand_are_the_same(pair):
    scene, hand = pair.problems()
    rng = np.random.default_rng(0)
    u, v = scene.u0 + 0.01 * rng.standard_normal(scene.u0.size), rng.standard_normal(scene.u0.size)
    # sums of terms of size 100 in another order
    np.testing.assert_allclose(acceleration(scene, u, v), acceleration(hand, u, v), rtol=1e-11, atol=1e-11)


@pytest.mark.parametrize("pair", scene_pairs.SCENE_PAIRS, ids=lambda pair: pair.title)
def test_effects_at_zero_strength_do_nothing(pair):
    crowd, others = scene_pairs.crowded(pair)
    full, lean = crowd.problem((0.0, 1.0)), pair.problems()[0]
    assert others >= 9
    u, v = lean.u0, np.ones(lean.u0.size)
    np.testing.assert_allclose(acceleration(full, u, v), acceleration(lean, u, v), rtol=1e-11, atol=1e-11)
    assert full.params.size > lean.params.size


def test_every_effect_is_there():
    kinds = {effects.Body, effects.Link, effects.Motion}
    known = {getattr(effects, name) for name in effects.__all__} - kinds
    known = {kind for kind in known if not issubclass(kind, effects.Cell)}  # the scenes of this benchmark have no cells
    known = {kind for kind in known if not hasattr(kind, "event")}  # which would add events to every scene
    for strength in (0.0, 1.0):
        assert {type(effect) for effect in scene_pairs.catalogue(3, strength)} == known


@pytest.mark.parametrize("pair", scene_pairs.SCENE_PAIRS, ids=lambda pair: pair.title)
def test_another_effect_in_the_catalogue_changes_no_instruction(pair, monkeypatch):
    monkeypatch.setattr(scenes, "SCENE_PAIRS", (pair,))
    ((_, by_hand, before, after, same),) = scenes.instructions()
    assert int(by_hand) > 20
    assert int(before) == int(after) > 20
    assert same == "yes"


def test_the_command(tmp_path, monkeypatch):
    """With one scene, and three effects in the catalogue: each is compiled for every table that it is in."""

    def few(dimension, strength):
        chosen = (effects.Gravity, effects.LinearSpring, effects.SofteningSpring)
        return (effect for effect in catalogue(dimension, strength) if isinstance(effect, chosen))

    catalogue = scene_pairs.catalogue
    monkeypatch.setattr(scene_pairs, "catalogue", few)
    monkeypatch.setattr(scenes, "SCENE_PAIRS", scene_pairs.SCENE_PAIRS[:1])
    monkeypatch.setattr(scenes, "_SECONDS", 1e-4)
    lines = []
    scenes.benchmark(repeats=1, out=tmp_path, write=lines.append)
    text = "\n".join(lines)
    assert text.count("| spring pendulum, Cartesian") == 3
    assert "NO" not in text
    assert "+ SofteningSpring" in text
    assert (tmp_path / "scenes.png").read_bytes().startswith(b"\x89PNG")
