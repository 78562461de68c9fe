"""A camera that hovers over a road full of vehicles with more texture than the ground."""

from __future__ import annotations

from dataclasses import replace

from motion_detect_ros.sources.synthetic import FlightConfig, ObjectSpec, SyntheticFlight


def traffic(speed_m_s: float, pictures: int) -> SyntheticFlight:
    """45 m over nine lanes in turn directions; every fourth vehicle is a lorry."""
    vehicles, lengths_m, gap_m = list[ObjectSpec](), (4.4, 4.4, 12.0, 4.4), 3.0
    for lane in range(-4, 5):
        front_m = -32.0 + 1.5 * (lane + 4)
        for number in range(10):
            length_m = lengths_m[(number + lane) % 4]
            vehicles.append(ObjectSpec('box', front_m + length_m / 2.0, 4.0 * lane, 180.0 * (lane % 2), speed_m_s,
                                       length_m, 2.5 if length_m > 5.0 else 1.8, 1.5))
            front_m += length_m + gap_m
    flight = replace(FlightConfig.approach(0.0, frames=pictures), width=960, height=540, altitude_m=45.0,
                     objects=tuple(vehicles))
    return SyntheticFlight(flight)
