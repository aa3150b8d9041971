"""A model and an effect of your own
=================================

A model and an effect of your own: the axis of the EMPS benchmark, with and without dry friction.

EMPS is a carriage driven along a rail by a motor (Janot, Gautier & Brunot 2019, a benchmark of
nonlinear system identification): ``mass * a = force - viscous * v - offset``, and dry friction. The
model is fitted to one run and tried on a second one, disturbed by pulses that its force includes.

Out come the errors over the whole of both runs without dry friction and with it, the parameters
beside the published ones, and a figure of the unseen run. A model and an effect that are written
here, in a script, work wherever those of the package do: a spec file names them as
``model = "own_model.py:Axis"`` and ``effects = ["own_model.py:DryFriction"]``.

    python examples/own_model.py [FOLDER FOR THE FIGURE]
"""

import jax.numpy as jnp

import diffthrust as dft


class Axis(dft.Model):
    """A carriage on a rail with viscous friction, pushed by a motor."""

    name = "emps_axis"
    inputs = {"force": "N"}
    states = {"position": "m", "velocity": "m/s"}
    outputs = states
    ports = {"friction": "force against the motion [N]"}
    mass: float = dft.parameter(50.0, "kg", bounds=(0, None))
    viscous: float = dft.parameter(100.0, "N s/m", bounds=(0, None))
    offset: float = dft.parameter(0.0, "N", size=5.0)

    def equations(self, s, port):
        """Rates of the states, and the outputs."""
        friction = port("friction", self.viscous * s.velocity)
        acceleration = (s.force - friction - self.offset) / self.mass
        seen = {"position": s.position, "velocity": s.velocity}
        return {"position": s.velocity, "velocity": acceleration}, seen


class DryFriction(dft.Effect):
    """Friction of constant size against the motion, smoothed within ``width`` of rest."""

    name, port = "dry_friction", "friction"
    level: float = dft.parameter(5.0, "N", bounds=(0, None), null=0.0, size=20.0)
    width: float = dft.parameter(1e-3, "m/s", fixed=True)

    def __call__(self, value, s):
        """The friction with the constant part."""
        return value + self.level * jnp.tanh(s.velocity / self.width)


if __name__ == "__main__":
    from _data import output_folder, runs_of

    train, unseen = runs_of(dft.datasets.emps).logs.values()
    models = Axis(), Axis() + DryFriction()
    before, after = (dft.fit(model, train, holdout=unseen) for model in models)
    print(after.report())
    print("published: mass 95.11 kg, viscous 203.5 N s/m, dry friction 20.39 N, offset -3.165 N")
    without, left = before.holdout.nrmse, after.holdout.nrmse
    print(f"Unseen NRMSE: without dry friction {without:.4f}, with it {left:.4f}.")
    print("The position adds up all errors of the force: what remains changes slowly.")
    dft.compare(after, unseen).plot().savefig(output_folder() / "emps_unseen.png", dpi=100)
