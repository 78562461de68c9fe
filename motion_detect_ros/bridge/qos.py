"""Quality of service of every topic, in one place."""

from __future__ import annotations

from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSPolicyKind, QoSProfile, QoSReliabilityPolicy
from rclpy.qos_overriding_options import QosCallbackResult, QoSOverridingOptions

#: Small records may queue; images may not, an old one is worth nothing.
IMAGE_DEPTH = 1
RECORD_DEPTH = 5
CLOCK_DEPTH = 100
LATCHED_DEPTH = 100
IMU_DEPTH = 400
DIAGNOSTICS_DEPTH = 10
MAX_DEPTH = 100_000
RELIABILITIES = {'auto': QoSReliabilityPolicy.RELIABLE, 'reliable': QoSReliabilityPolicy.RELIABLE,
                 'best_effort': QoSReliabilityPolicy.BEST_EFFORT}
#: Words of the parameter image_reliability, and of image_transport.
IMAGE_RELIABILITIES, IMAGE_TRANSPORTS = tuple(RELIABILITIES), ('raw', 'compressed')


def image_qos(reliability: str = 'reliable', depth: int = IMAGE_DEPTH) -> QoSProfile:
    """For images and flow. reliability: ``reliable`` or ``best_effort``; ``auto``: reliable as long as that works."""
    return QoSProfile(history=QoSHistoryPolicy.KEEP_LAST, depth=depth, reliability=RELIABILITIES[reliability])


def record_qos() -> QoSProfile:
    """For ego-motion and detections."""
    return QoSProfile(history=QoSHistoryPolicy.KEEP_LAST, depth=RECORD_DEPTH,
                      reliability=QoSReliabilityPolicy.RELIABLE)


def clock_qos() -> QoSProfile:
    """For ``/clock``: whoever steps through time must not miss a step."""
    return QoSProfile(history=QoSHistoryPolicy.KEEP_LAST, depth=CLOCK_DEPTH,
                      reliability=QoSReliabilityPolicy.RELIABLE)


def diagnostics_qos() -> QoSProfile:
    """For ``/diagnostics``: that of diagnostic_updater."""
    return QoSProfile(history=QoSHistoryPolicy.KEEP_LAST, depth=DIAGNOSTICS_DEPTH,
                      reliability=QoSReliabilityPolicy.RELIABLE)


def best_effort(quality: QoSProfile) -> QoSProfile:
    """The same, taking what a best-effort publisher offers."""
    return QoSProfile(history=quality.history, depth=quality.depth, reliability=QoSReliabilityPolicy.BEST_EFFORT)


def imu_qos(reliability: str = 'reliable') -> QoSProfile:
    """For ``imu``: none of the samples between two images may be missing."""
    return QoSProfile(history=QoSHistoryPolicy.KEEP_LAST, depth=IMU_DEPTH, reliability=RELIABILITIES[reliability])


def latched_qos() -> QoSProfile:
    """For ``/tf_static``: late subscribers get it too."""
    return QoSProfile(history=QoSHistoryPolicy.KEEP_LAST, depth=LATCHED_DEPTH,
                      reliability=QoSReliabilityPolicy.RELIABLE, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)


def overridable() -> QoSOverridingOptions:
    """Lets users set history, depth and reliability by the standard ``qos_overrides`` parameters."""
    return QoSOverridingOptions(
        [QoSPolicyKind.HISTORY, QoSPolicyKind.DEPTH, QoSPolicyKind.RELIABILITY], callback=_checked)


def incompatibility(topic: str, policy: str, ours: QoSProfile) -> str:
    """In a few words why a publisher's messages do not arrive, and what helps. policy: name of the one that differs."""
    wanted = getattr(ours, policy.lower(), None)
    cure = ''
    if policy == 'RELIABILITY':
        cure = f'; set image_reliability:=best_effort or qos_overrides.{topic}.subscription.reliability:=best_effort'
    return f'a publisher of {topic} offers another {policy.lower()} than {getattr(wanted, "name", wanted)}{cure}'


def _checked(profile: QoSProfile) -> QosCallbackResult:
    """DDS takes other depths for an error that it reports on dozens of lines."""
    fits = 1 <= profile.depth <= MAX_DEPTH
    reason = '' if fits else f'depth: expected 1 to {MAX_DEPTH}, got {profile.depth}'
    return QosCallbackResult(successful=fits, reason=reason)
