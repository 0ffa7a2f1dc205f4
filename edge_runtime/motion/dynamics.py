"""From actions to predicted motion: the linear dynamics that a bundle's manifest states.

One control step, as VMAS integrates it: drag takes its share of the velocity once, then ``substeps``
semi-implicit Euler steps of ``dt / substeps`` apply the action as a force,

    v <- (1 - drag) v,   then repeatedly   v <- v + (u / m) dt_s,   p <- p + v dt_s.

With ``mass_kg`` 1 and ``drag`` 0 this is the paper's v' = v + a dt, p' = p + v' dt (section III).
"""

import msgspec


class Preview(msgspec.Struct, frozen=True, gc=False):
    """Motion some steps ahead under a constant action u: linear, with the same gains on every axis.

    v' = velocity_decay v + velocity_gain u
    p' = p + position_decay v + position_gain u
    """

    velocity_decay: float
    velocity_gain: float
    """dv'/du in (m/s) per unit of action."""
    position_decay: float
    """dp'/dv in seconds."""
    position_gain: float
    """dp'/du in m per unit of action."""


class Dynamics(msgspec.Struct, frozen=True, gc=False, forbid_unknown_fields=True):
    """How a robot moves under its policy's action."""

    mass_kg: float
    """What divides the force."""
    drag: float
    """Share of the velocity lost in one step, in [0, 1)."""
    dt_s: float
    """Of one control step."""
    substeps: int = 1
    """In which a control step is integrated."""

    def preview(self, steps: int) -> Preview:
        """Predict ``steps`` control periods ahead under a constant action.

        Raises:
            ValueError: if ``steps`` is below one.
        """
        if steps < 1:
            raise ValueError(f"a preview looks at least one step ahead, got {steps}")
        keep = 1.0 - self.drag
        gain = self.dt_s / self.mass_kg
        # Position after S substeps of a ramping velocity: dt v plus the mean of the ramp, (S + 1) / (2 S).
        ramp = self.dt_s * (self.substeps + 1) / (2 * self.substeps)
        velocity_decay, velocity_gain, position_decay, position_gain = 1.0, 0.0, 0.0, 0.0
        for _ in range(steps):
            position_decay += self.dt_s * keep * velocity_decay
            position_gain += self.dt_s * keep * velocity_gain + ramp * gain
            velocity_decay *= keep
            velocity_gain = keep * velocity_gain + gain
        return Preview(velocity_decay, velocity_gain, position_decay, position_gain)

    def at_period(self, period_s: float) -> "Dynamics":
        """The same robot integrated with another period: drag is compounded, mass stays."""
        keep = (1.0 - self.drag) ** (period_s / self.dt_s)
        return Dynamics(self.mass_kg, 1.0 - keep, period_s, self.substeps)

    def scaled(self, scale_m: float) -> "Dynamics":
        """The same motion in a world where one of these metres is ``scale_m``, under the same action."""
        return Dynamics(self.mass_kg / scale_m, self.drag, self.dt_s, self.substeps)
