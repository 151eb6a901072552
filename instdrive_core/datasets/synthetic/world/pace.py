"""How far along its way something is at a time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class StopAndGo:
    """Standing, speeding up and slowing down, again and again, as vehicles in a jam do.

    Whoever follows repeats the movement of the vehicle ahead some time later, as in Newell's car-following model (A
    simplified car-following theory, 2002): a vehicle that is `lead` seconds before another in the wave never comes
    closer to it than when both stand.
    """

    lead: float = 0.0
    """Seconds by which the movement runs ahead of that of a vehicle with lead 0."""
    top_speed: float = 2.5
    """Metres per second, reached halfway between two stops."""
    period: float = 6.0
    """Seconds from one stop to the next."""
    standing: float = 1.0
    """Seconds of each stop."""

    def travel(self, time: float) -> float:
        """Metres from where it was at time 0 to where it is at `time` seconds."""
        return self.measure_wave(time) - self.measure_wave(0.0)

    def compute_speed(self, time: float) -> float:
        """Metres per second at `time` seconds."""
        rolling = (time + self.lead) % self.period - self.standing
        turn = 2 * np.pi * rolling / (self.period - self.standing)
        return float(0.5 * self.top_speed * (1 - np.cos(turn))) if rolling > 0 else 0.0

    def measure_wave(self, time: float) -> float:
        """Metres that the wave's first vehicle has come since its first stop began."""
        rounds, since = divmod(time + self.lead, self.period)
        lasting = self.period - self.standing
        rolling = max(0.0, since - self.standing)
        swing = lasting / (2 * np.pi) * np.sin(2 * np.pi * rolling / lasting)
        return float(0.5 * self.top_speed * (rounds * lasting + rolling - swing))
