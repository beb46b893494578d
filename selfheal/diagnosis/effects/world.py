"""The robot's surroundings."""

import numpy as np

from ..scene import Scene
from ..terms import Effect, Floats, Parameter, Term


class OfWorld(Effect):
    """What all of them share: one place, the world."""

    group = "world"

    def whole(self, parameters, starts) -> Term:
        """The term at the world."""
        return Term(self, ("world",), ({},), parameters, starts)


class Slope(OfWorld):
    name = "slope"
    says = "What is taken for horizontal is tilted."
    equation = "gravity turned by tilt towards the downhill direction azimuth"
    source = "MuJoCo option/gravity"
    separate_by = "turn the robot by 180 degrees: a slope turns with the room"

    def terms(self, scene):
        if not np.linalg.norm(scene.model.opt.gravity):
            return []
        parameters = (
            Parameter("tilt", "rad", 0.0, 0.0, 1.0, 0.03),
            Parameter("azimuth", "rad", 0.0, -10.0, 10.0, 0.5),
        )
        turns = np.deg2rad((0, 90, 180, -90))
        return [self.whole(parameters, tuple((0.05, float(a)) for a in turns))]

    def edit(self, model, place, values):
        tilt, azimuth = values
        size = np.linalg.norm(model.opt.gravity)
        up = -model.opt.gravity / size
        down = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
        down -= (down @ up) * up
        down /= max(np.linalg.norm(down), 1e-9)
        model.opt.gravity[:] = size * (np.sin(tilt) * down - np.cos(tilt) * up)


class FluidDrag(OfWorld):
    name = "fluid_drag"
    rare = True
    says = "Air or water resists the parts that move through it."
    equation = "MuJoCo's inertia-box fluid model, of density or viscosity"
    source = "MuJoCo option/density, viscosity"
    separate_by = "change the area of a moving part"
    regime = "fast"

    def terms(self, scene):
        now = scene.model.opt
        return [
            self._of("density", "kg/m^3", now.density, 1e4, (1.2, 50.0, 500.0)),
            self._of("viscosity", "Pa s", now.viscosity, 100.0, (0.01, 0.3, 3.0)),
        ]

    def _of(self, name: str, unit: str, now: float, high: float, starts) -> Term:
        parameter = Parameter(name, unit, float(now), 0.0, high, starts[1])
        begin = tuple((s,) for s in starts)
        return Term(self, ("world",), ({"field": name},), (parameter,), begin)

    def edit(self, model, place, values):
        setattr(model.opt, place["field"], values[0])


class Wind(OfWorld):
    name = "wind"
    rare = True
    says = "The air moves."
    equation = "drag of the velocity relative to (vx, vy, vz)"
    source = "MuJoCo option/wind"
    separate_by = "turn the robot by 180 degrees"

    def terms(self, scene):
        if not scene.model.opt.density:
            return []
        axes = tuple(
            Parameter("v" + x, "m/s", float(scene.model.opt.wind[i]), -50.0, 50.0, 1.0)
            for i, x in enumerate("xyz")
        )
        return [self.whole(axes, ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0)))]

    def edit(self, model, place, values):
        model.opt.wind[:] = values


class OfGround(OfWorld):
    """What the ground does where something touches it."""

    def grounds(self, scene: Scene, parameters, starts) -> list[Term]:
        """The world's geoms that something can touch."""
        model = scene.model
        fixed = np.flatnonzero(model.body_weldid[model.geom_bodyid] == 0)
        touch = model.geom_contype[fixed] | model.geom_conaffinity[fixed]
        geoms = tuple(int(g) for g in fixed[touch > 0])
        if not geoms or not scene.touches:
            return []
        return [Term(self, ("world",), ({"geoms": geoms},), parameters, starts)]

    def first(self, model, place) -> Floats:
        """The ground's geoms, made to decide a contact's properties."""
        geoms = np.array(place["geoms"])
        model.geom_priority[geoms] = model.geom_priority.max() + 1
        return geoms


class GroundFriction(OfGround):
    name = "ground_friction"
    says = "The ground is more slippery, or rougher, than stated."
    equation = "|f_tangential| <= friction f_normal"
    source = "MuJoCo geom/friction"
    separate_by = "push the resting robot until it slides"
    regime = "contact"

    def terms(self, scene):
        fixed = scene.model.geom_friction[:, 0]
        now = float(fixed.max()) if len(fixed) else 1.0
        parameter = Parameter("friction", "1", now, 0.0, 5.0, 0.2)
        return self.grounds(scene, (parameter,), ((0.1,), (0.3,), (0.6,), (1.5,)))

    def edit(self, model, place, values):
        model.geom_friction[self.first(model, place), 0] = values[0]


class GroundCompliance(OfGround):
    name = "ground_compliance"
    says = "The ground gives way, or bounces, otherwise than stated."
    equation = "contact as a spring and damper of timeconst and dampratio"
    source = "MuJoCo geom/solref"
    separate_by = "drop a part from two heights"
    regime = "contact"

    def terms(self, scene):
        parameters = (
            Parameter("timeconst", "s", 0.02, 2 * scene.step, 0.3, 0.005),
            Parameter("dampratio", "1", 1.0, 0.02, 5.0, 0.1),
        )
        starts = ((0.02, 0.3), (0.01, 0.1), (0.05, 0.5), (0.06, 1.0))
        return self.grounds(scene, parameters, starts)

    def edit(self, model, place, values):
        model.geom_solref[self.first(model, place)] = values
