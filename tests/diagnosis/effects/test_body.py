"""Effects of bodies: where they have a place, and how large they may be."""

from selfheal.diagnosis.effects import find_effect
from tests.support.effect_robots import make_pendulum


def test_a_hand_may_bear_as_much_as_all_that_moves(benches):
    b = benches["arm"]
    for term in find_effect("payload").propose_terms(b.robot):
        assert term.high[0] >= sum(body.mass for body in b.robot.bodies)


def test_a_hand_carries_what_the_arm_that_it_is_fixed_to_does_not(tmp_path):
    hand = """<body name="hand" pos="0 0 -0.2"><geom size="0.03" mass="0.1"/>
      <body name="tip" pos="0 0 -0.05"/></body></body></worldbody>"""
    b = make_pendulum(tmp_path, **{"</body>\n  </worldbody>": hand})
    targets = {
        name: [t.targets for t in find_effect(name).propose_terms(b.robot)]
        for name in ("payload", "com_shift", "mount_shift")
    }
    assert targets == {
        "payload": [("body:hand",)],
        "com_shift": [("body:rod",), ("body:hand",)],
        "mount_shift": [("body:hand",)],  # the tip weighs nothing
    }
