"""Mechanisms in files of MuJoCo have the masses, and move, as in MuJoCo; what a scene does not have is named."""

from contextlib import suppress
from itertools import combinations

import mujoco
import numpy as np
import pytest

import eig3
from eig3.files.mjcf import read_mjcf
from eig3.scene import Scene

#: Bodies with solids of every kind, classes of defaults, frames, and every orientation; nothing moves yet.
SOLIDS = """<mujoco><compiler eulerseq="xZy"/><option gravity="0 1 -3"><flag contact="disable"/></option>
<default><geom density="700"/><default class="heavy"><geom density="3000" size="0.03"/>
  <default class="long"><geom type="capsule"/></default></default></default>
<worldbody><geom type="plane" size="1 1 1"/>
  <body name="sphere" pos="1 0 0"><freejoint/><geom size="0.1" pos="0.1 0 0"/></body>
  <body name="capsule" euler="10 20 30"><freejoint/><geom class="long" fromto="0 0 0 0.2 0.1 -0.3"/></body>
  <body name="cylinder" quat="1 2 3 4"><freejoint/><geom type="cylinder" size="0.1 0.3" zaxis="1 2 0"/></body>
  <body name="ellipsoid" axisangle="1 1 0 40"><freejoint/><geom type="ellipsoid" size="0.1 0.2 0.3" mass="2"/></body>
  <frame pos="0 0 2" euler="0 30 0"><body name="box" xyaxes="1 1 0 0 1 1" childclass="heavy"><joint type="ball"/>
    <geom type="box" size="0.1 0.2 0.3" pos="1 0 0"/><geom pos="0 1 0" group="3"/><geom mass="0"/>
    <geom type="box" size="0.02" fromto="0 0 0 1 0 1" density="90"/>
    <body name="tool" pos="0 0 1" euler="90 0 0"><geom type="ellipsoid" size="0.05" fromto="0 0 0 0 0.3 0"/>
      <inertial pos="0.1 0 0" mass="1.5" fullinertia="0.02 0.03 0.04 0.001 0.002 0.003"/></body>
  </body></frame>
  <body name="disc"><joint type="slide"/><inertial pos="0 0 0.1" quat="1 1 0 0" mass="2" diaginertia="1 2 2.5"/></body>
</worldbody></mujoco>"""


def both(tmp_path, text, **options):
    """Return what eig3 and MuJoCo read from a file."""
    (tmp_path / "model.xml").write_text(text)
    return Scene.read(tmp_path / "model.xml", **options), mujoco.MjModel.from_xml_string(text)


def test_masses_and_inertias_are_as_in_mujoco(tmp_path):
    """For each body with the bodies welded to it, to round-off; MuJoCo gives principal moments and their axes."""
    found, model = both(tmp_path, SOLIDS)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    groups = {name: [name] for name in ("sphere", "capsule", "cylinder", "ellipsoid", "disc")} | {
        "box": ["box", "tool"]
    }
    assert found.bodies["tool"] is found.bodies["box"]
    for name, members in groups.items():
        ids = [model.body(member).id for member in members]
        masses, centres = model.body_mass[ids], data.xipos[ids]
        centre = masses @ centres / masses.sum()
        inertia = np.zeros((3, 3))
        for i, m, x in zip(ids, masses, centres - centre, strict=True):
            axes = data.ximat[i].reshape(3, 3)
            inertia += axes @ np.diag(model.body_inertia[i]) @ axes.T + m * (x @ x * np.eye(3) - np.outer(x, x))
        body = found.bodies[name]
        m, squares = (found.scene._cloud().masses[points.numbers] for points in (body.centre, body.axes))
        axes = body.axes.position.T
        np.testing.assert_allclose(m, masses.sum(), rtol=1e-13)
        np.testing.assert_allclose(body.centre.position, centre, rtol=0, atol=1e-13)
        mine = axes @ np.diag(squares.sum() - squares) @ axes.T
        np.testing.assert_allclose(mine, inertia, rtol=0, atol=1e-12 * inertia.max())
    problem = found.scene.problem((0, 1))
    quaternion = np.roll(data.body("cylinder").xquat, -1)
    np.testing.assert_allclose(abs(found.bodies["cylinder"].rotation(problem.u0) @ quaternion), 1.0, rtol=1e-14)
    assert "6 x Gravity" in problem.note
    assert found.timestep == 0.002


def test_the_solids_are_drawn_where_mujoco_has_them(tmp_path):
    """Their middles and semi-axes, which are the columns of the frame of a geom times its sizes."""
    found, model = both(tmp_path, SOLIDS)
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    problem = found.scene.problem((0, 1))
    x = problem.view.places(np.zeros(1), problem.u0[None])[0]
    drawn = [
        (solid.kind, x[solid.points[0]], x[list(solid.points[1:])] - x[solid.points[0]])
        for solid in problem.view.solids
    ]
    kinds = {2: "sphere", 3: "capsule", 4: "sphere", 5: "cylinder", 6: "box"}
    geoms = [i for i in range(model.ngeom) if model.geom_bodyid[i]]
    assert sum(solid.is_given for solid in problem.view.solids) == len(geoms)
    for i in geoms:
        kind, size = kinds[model.geom_type[i]], model.geom_size[i]
        lengths = {"sphere": size if size[1] else size[[0, 0, 0]], "box": size}.get(kind)
        if lengths is None:
            lengths = np.array([size[0], size[0], size[1] + size[0] * (kind == "capsule")])
        axes = lengths[:, None] * data.geom_xmat[i].reshape(3, 3).T
        near = [abs(at - data.geom_xpos[i]).max() + abs(a - axes).max() for k, at, a in drawn if k == kind]
        assert min(near) < 1e-12


#: A chain with every joint, springs, dampers, motors, and a body without a joint, after a test of MuJoCo.
CHAIN = """<mujoco><compiler angle="radian"/><option integrator="RK4"><flag contact="disable"/></option>
<default><geom type="capsule" size="0.02"/></default>
<worldbody><body name="arm" pos="0.15 0 0" euler="0.1 0.2 0.3">
  <joint name="shoulder" axis="0 1 0.1" stiffness="0.4" springref="0.3" ref="0.1" damping="0.01"/>
  <geom fromto="0 0 0 0.1 0 0"/><body name="tool" pos="0.05 0 0"><geom type="box" size="0.03 0.01 0.02"/></body>
  <body name="piston" pos="0.1 0 0"><joint name="slide" type="slide" axis="1 0 0" stiffness="200" damping="0.5"/>
    <geom size="0.015" fromto="-0.1 0 0 0.1 0 0"/>
    <body name="ball" pos="0.1 0 0"><joint type="ball" pos="0.01 0 0"/><geom type="box" size="0.02 0.05 0.02"/>
      <body name="cross" pos="0 0.1 0"><joint axis="1 0 0"/><joint axis="0.2 0 1"/><geom fromto="0 0 0 0 0.1 0.02"/>
        <body name="table" pos="0 0.1 0"><joint type="slide" axis="1 0 0" stiffness="20" springref="-0.01"/>
          <joint name="lift" type="slide" axis="0 0 1" stiffness="30"/>
          <joint axis="0 1 0" damping="1e-4" stiffness="2e-3" springref="-0.3"/>
          <geom type="ellipsoid" size="0.03 0.02 0.01" pos="0.01 0 0.01"/><site name="tip" pos="0.1 0 0"/></body>
      </body></body></body></body></worldbody>
<actuator><motor name="turn" joint="shoulder" gear="0.5" ctrlrange="-1 0.4"/><motor name="push" joint="slide" gear="3"/>
  <motor name="idle" joint="lift" forcerange="-1 1"/></actuator></mujoco>"""


controller = eig3.jit(lambda t, q, rate: 0.4 * np.sin(20 * t) - 5.0 * q - 0.1 * rate)


@pytest.mark.system
def test_a_chain_moves_as_in_mujoco(tmp_path):
    """The errors of MuJoCo's RK4 are of order 4: half the step has 1/16 of them. They are 2e-7 at 0.5 ms."""
    found, model = both(tmp_path, CHAIN)
    assert found.motors == ("turn", "push", "idle")
    found.drive("turn", 2.0)
    found.drive("push", controller)
    problem = found.scene.problem((0.0, 0.5), work=True)
    run = problem.integrate(h=1e-3, method="rk8")
    assert run.drift["energy"] < 1e-9 * np.ptp(problem.energy_of(run.u, run.v, run.t))  # springs have potentials
    names = ["arm", "piston", "ball", "cross", "table"]
    slide = model.joint("slide").qposadr[0], model.joint("slide").dofadr[0]

    def control(model, data):
        data.ctrl[:2] = 2.0, controller.py_func(data.time, data.qpos[slide[0]], data.qvel[slide[1]])

    errors = []
    try:
        mujoco.set_mjcb_control(control)
        for halved in (2, 4):
            data = mujoco.MjData(model)
            model.opt.timestep = 1e-3 / halved
            mujoco.mj_step(model, data, nstep=500 * halved)
            mujoco.mj_forward(model, data)
            tip = found.sites["tip"].positions(run.u[-1]) - data.site("tip").xpos
            turns = [found.bodies[name].axes.positions(run.u[-1]).T @ found.bodies[name].principal.T for name in names]
            theirs = [data.body(name).xmat.reshape(3, 3) for name in names]
            errors.append(max(abs(tip).max(), np.abs(np.subtract(turns, theirs)).max()))
    finally:
        mujoco.set_mjcb_control(None)
    assert errors[0] < 1e-6
    assert errors[1] < errors[0] / 12
    assert abs(data.qpos[slide[0]]) > 1e-3


#: A four-bar linkage in a tilted plane, whose loop a connect closes.
FOUR_BAR = """<mujoco><option integrator="RK4" tolerance="1e-15"><flag contact="disable"/></option>
<default><geom type="capsule" size="0.01"/><joint axis="0 1 0"/>
  <equality solref="{spring} 1" solimp="0.9999 0.9999 0.001 0.5 2"/></default>
<worldbody><frame euler="20 0 50">
  <body name="crank"><joint name="drive"/><geom fromto="0 0 0 0 0 0.1"/>
    <body name="coupler" pos="0 0 0.1"><joint/><geom fromto="0 0 0 0.3 0 0.15"/></body></body>
  <body name="rocker" pos="0.4 0 0"><joint/><geom fromto="0 0 0 -0.1 0 0.25"/></body></frame></worldbody>
<equality><connect body1="coupler" body2="rocker" anchor="0.3 0 0.15"/></equality>
<actuator><motor name="motor" joint="drive"/></actuator></mujoco>"""


@pytest.mark.system
def test_a_four_bar_linkage_moves_as_in_mujoco(tmp_path):
    """The loop of MuJoCo has a spring that relaxes in two steps: with a quarter of the step, the difference is 1/16."""
    differences = []
    for h in (5e-4, 1.25e-4):
        found, model = both(tmp_path, FOUR_BAR.format(spring=2 * h))
        if not differences:
            found.drive("motor", 0.05)
            run = found.scene.problem((0.0, 0.5)).integrate(h=5e-4, method="rk4")
        model.opt.timestep = h
        data = mujoco.MjData(model)
        data.ctrl[:] = 0.05
        mujoco.mj_step(model, data, nstep=round(0.5 / h))
        mujoco.mj_forward(model, data)
        moved = [
            found.bodies[name].centre.positions(run.u[-1]) - data.body(name).xipos for name in ("coupler", "rocker")
        ]
        differences.append(np.abs(moved).max())
    assert differences[0] < 1e-4
    assert differences[1] < differences[0] / 8
    assert np.ptp(found.bodies["rocker"].centre.positions(run.u), axis=0).max() > 0.02


@pytest.mark.parametrize(
    ("element", "joint", "added"),
    [
        ("connect", "hinge", {"Along": 2}),
        ("weld", "hinge", {"Along": 2, "Perpendicular": 1}),
        ("connect", "ball", {"PointJoint": 1}),
    ],
)
def test_a_loop_in_a_plane_has_no_redundant_constraints(element, joint, added, tmp_path):
    """A scene with constraints that depend on each other has no problem. With a ball joint, no loop is flat."""
    text = FOUR_BAR.format(spring=0.01).replace("<connect", f"<{element}")
    text = text.replace('pos="0.4 0 0"><joint/>', f'pos="0.4 0 0"><joint type="{joint}"/>')
    both(tmp_path, text)[0].scene.problem((0, 1))
    note, without = (
        dict(
            line.split(" x ")[::-1]
            for line in both(tmp_path, given)[0].scene.problem((0, 1)).note.splitlines()
            if " x " in line
        )
        for given in (text, text.replace(f"<{element}", f'<{element} active="false"'))
    )
    for name in ("Along", "Perpendicular", "PointJoint"):
        assert int(note.get(name, 0)) - int(without.get(name, 0)) == added.get(name, 0)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('<flag contact="disable"/>', "", r"contact \(of a geom and a geom, ...\)\. .* give ignore=\('contact',\)"),
        ('<joint name="drive"/>', '<joint name="drive" range="0 90"/>', r"range \(joint 'drive'\)"),
        ('<joint name="drive"/>', '<joint name="drive" armature="1e-3"/>', r"armature \(armature of joint 'drive'\)"),
        ('<joint name="drive"/>', '<joint name="drive" damping="1 2"/>', r"damping \(of joint 'drive'\)"),
        ('<motor name="motor"', '<position name="motor"', r"actuator \(position 'motor'\)"),
        ("<connect ", '<joint joint1="drive"/><connect ', r"equality \(a joint\)"),
        ("<option ", '<option density="1.2" ', r"fluid \(density of an option\)"),
    ],
)
def test_what_a_scene_leaves_out_is_named(old, new, message, tmp_path):
    """The error names what to ignore; with it, the file is read."""
    text = FOUR_BAR.format(spring=0.01)
    assert old in text
    with pytest.raises(ValueError, match=message) as refused:
        both(tmp_path, text.replace(old, new, 1))
    ignore = eval(str(refused.value).rpartition("ignore=")[2].rstrip("."))
    assert both(tmp_path, text.replace(old, new, 1), ignore=ignore)[0].motors in ((), ("motor",))


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (
            "<joint/>",
            '<joint/><joint axis="0 0 1" pos="0 0 1"/>',
            "has the joints hinge, hinge in body 'coupler', instead",
        ),
        ("<joint/>", '<joint springdamper="0.1 1"/>', "has springdamper='0.1 1' in a joint, which is not supported"),
        ("<joint/>", '<joint axis="0 one 0"/>', "has axis='0 one 0', not numbers"),
        ("<equality>", "<deformable/><equality>", "has the element deformable, which is not supported"),
        ("<worldbody>", '<worldbody><replicate count="2"/>', "has the element replicate"),
        ('body2="rocker"', 'body2="rocket"', "has no body 'rocket', but a constraint of it"),
        (
            '<connect body1="coupler"',
            '<weld relpose="0 0 0 1 0 0 0" body1="coupler"',
            "has relpose='0 0 0 1 0 0 0' in a weld",
        ),
        ('<geom fromto="0 0 0 0 0 0.1"/>', "", "must give a mass to the body 'crank', which moves"),
        ("<default>", '<compiler settotalmass="3"/><default>', "has settotalmass='3' in a compiler"),
        ('type="capsule" size="0.01"', 'type="cylinder" size="0.01" shellinertia="true"', "has shellinertia='true'"),
        (
            "<joint/>",
            '<joint type="slide"/><joint type="slide" axis="0 1 1"/>',
            "has the joints slide, slide in body 'coupler', instead of slides at right angles",
        ),
        ('<joint name="drive"/>', '<joint name="drive" axis="0 0 0"/>', "has axis='0 0 0' in joint 'drive'"),
        (
            '<joint name="drive"/>',
            '<joint name="drive" stiffness="1" springref="-170" ref="10"/>',
            "has a springref half a turn or more from ref in joint 'drive'",
        ),
        ("<default>", '<default class="arm">', "has class='arm', and not 'main', in the default at its top"),
        ("</mujoco>", "", "is not an XML file: no element found"),
    ],
)
def test_what_is_not_supported_is_named(old, new, message, tmp_path):
    text = FOUR_BAR.format(spring=0.01)
    assert old in text
    (tmp_path / "model.xml").write_text(text.replace(old, new, 1))
    with pytest.raises(ValueError, match=message):
        Scene.read(tmp_path / "model.xml", ignore=("contact", "range"))


def test_passive_disables_springs_and_dampers(tmp_path):
    """Without a spring, any springref is read."""
    text = FOUR_BAR.format(spring=0.01).replace('contact="disable"', 'contact="disable" passive="disable"')
    text = text.replace('name="drive"', 'name="drive" stiffness="2" damping="1" springref="720"', 1)
    (tmp_path / "model.xml").write_text(text)
    joint = read_mjcf(tmp_path / "model.xml").bodies[0].joints[0]
    assert (joint.name, joint.stiffness, joint.damping) == ("drive", 0.0, 0.0)


def test_geoms_touch_by_the_rules_of_mujoco(tmp_path):
    """Parents and children, excluded bodies and other bits do not; the ground is no parent."""
    pairs = """<mujoco><worldbody><geom name="floor" {floor}/>
      <body name="a"><freejoint/><geom name="a" {a}/><body><geom name="hand" {hand}/></body>
      <body name="b"><joint/><geom name="b" {b}/><body name="c"><joint/><geom name="c" {c}/></body></body></body>
      <body name="d"><freejoint/><geom name="d" {d}/></body><body name="e"><freejoint/><geom name="e" {e}/></body>
      </worldbody><contact><exclude body1="a" body2="c"/></contact></mujoco>"""
    bits = dict.fromkeys(("floor", "a", "hand", "b", "c"), (1, 1)) | {"d": (2, 4), "e": (4, 0)}

    def text(names):
        given = {name: bits[name] if name in names else (0, 0) for name in bits}
        return pairs.format(**{k: f'size="1" contype="{x}" conaffinity="{y}"' for k, (x, y) in given.items()})

    model = mujoco.MjModel.from_xml_string(text(bits))
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    theirs = {frozenset(model.geom(k).name for k in pair) for pair in data.contact.geom.tolist()}
    mine = set()
    for pair in combinations(bits, 2):
        (tmp_path / "pairs.xml").write_text(text(pair))
        with suppress(ValueError):
            read_mjcf(tmp_path / "pairs.xml")
            continue
        mine.add(frozenset(pair))
    assert mine == theirs


def test_motors_are_checked(tmp_path):
    found, _ = both(tmp_path, FOUR_BAR.format(spring=0.01))
    with pytest.raises(ValueError, match="motor must be one of motor, not 'crank'"):
        found.drive("crank", 1.0)
    with pytest.raises(TypeError, match="control must be a number, or a jitted function of t, or of t, q and rate"):
        found.drive("motor", lambda t: t)
    found.drive("motor", 1.0)
    with pytest.raises(ValueError, match="motor 'motor' has a control already"):
        found.drive("motor", 2.0)
    with pytest.raises(ValueError, match=r"ignore must have names of actuator, .*, not 'friction'"):
        Scene.read(tmp_path / "model.xml", ignore="friction")
    with pytest.raises(ValueError, match="leave out dimension and units"):
        Scene.read(tmp_path / "model.xml", length=1e-3)
    (tmp_path / "atoms.xyz").write_text("1\n\nAr 0 0 0\n")
    with pytest.raises(ValueError, match=r"ignore is for mechanisms of MuJoCo, with the ending \.xml"):
        Scene.read(tmp_path / "atoms.xyz", ignore=("contact",))
