"""The built-in flight: a drone over a drawn town, with exact boxes, flow, ego-motion and time to contact."""

from motion_detect_ros.sources.synthetic.config import FlightConfig, ObjectSpec
from motion_detect_ros.sources.synthetic.flight import SyntheticFlight, SyntheticFrame

__all__ = ['FlightConfig', 'ObjectSpec', 'SyntheticFlight', 'SyntheticFrame']
