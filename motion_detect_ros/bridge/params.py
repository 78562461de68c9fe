"""ROS parameters, declared by walking the settings of the perception core."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from difflib import get_close_matches
from typing import Any

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.exceptions import (
    InvalidParameterException,
    InvalidParameterTypeException,
    InvalidParameterValueException,
    ParameterException,
)
from rclpy.node import Node
from rclpy.parameter import Parameter

from motion_detect_ros.core.config import PipelineConfig
from motion_detect_ros.core.errors import ConfigError
from motion_detect_ros.core.reconfiguration import is_fixed
from motion_detect_ros.core.settings import Scalar, settings, with_settings
from motion_detect_ros.presets import is_node_parameter
from motion_detect_ros.sources.secrets import holds_secret, masked, reason_of

#: New values of parameters by name: whether they can be, and what follows from them.
Check = Callable[[dict[str, Scalar]], None]
Apply = Callable[[dict[str, Scalar]], None]
_REFUSED = (InvalidParameterException, InvalidParameterTypeException, InvalidParameterValueException,
            ParameterException)


def declare_config(node: Node, used: tuple[str, ...] = ('',)) -> PipelineConfig:
    """Declares the settings whose names begin with one of ``used``; returns the configuration that the user gave.

    Those of other stages keep their defaults. Raises: ConfigError, one line, for a wrong type or a value outside its
    range.
    """
    values = {name: declare(node, name, default, metadata)
              for name, default, metadata in settings(PipelineConfig()) if name.startswith(used)}
    return with_settings(PipelineConfig(), values)


def declare(node: Node, name: str, default: Scalar, metadata: Mapping[str, Any]) -> Scalar:
    """Declares one parameter from a setting's metadata; returns its value. Raises: ConfigError."""
    return declare_simple(node, name, default, _description(metadata), metadata.get('low'), metadata.get('high'),
                          metadata.get('choices', ()), live=not is_fixed(name))


def declare_simple(
    node: Node, name: str, default: Scalar, doc: str,
    low: float | None = None, high: float | None = None, choices: tuple[str, ...] = (), live: bool = False,
) -> Scalar:
    """Declares one parameter of a node, read-only unless ``live``.

    An integer is taken for a float (``rate:=2``) and for a text (``source:=0``), as YAML leaves users no other way to
    write them without quotes and points. Raises: ConfigError for another wrong type or value.
    """
    descriptor = ParameterDescriptor(description=doc, read_only=not live)
    if low is not None and high is not None:
        if isinstance(default, float):
            descriptor.floating_point_range = [FloatingPointRange(from_value=float(low), to_value=float(high))]
        else:
            descriptor.integer_range = [IntegerRange(from_value=int(low), to_value=int(high), step=1)]
    if choices:
        descriptor.additional_constraints = f'one of {", ".join(choices)}'
    try:
        value = _declared(node, name, default, descriptor)
    except _REFUSED as error:
        raise ConfigError(f'parameter {name}: {_refusal(error, default, low, high)}') from None
    if choices and value not in choices:
        raise ConfigError(f'parameter {name}: expected one of {", ".join(choices)}, got {value!r}')
    return value


def declare_address(node: Node, name: str, default: str, doc: str) -> str:
    """As ``declare_simple`` for a text that may hold credentials: whoever asks for the parameter gets them masked."""
    given = getattr(node, '_parameter_overrides', {}).get(name)  # rclpy would announce it as it is
    value = given.value if given is not None else default
    if not holds_secret(value):
        return str(declare_simple(node, name, default, doc))
    node.declare_parameter(
        name, masked(value), ParameterDescriptor(description=doc, read_only=True), ignore_override=True)
    return value


class LiveParameters:
    """Parameters that may change while a node runs: those that are set together are checked together, then applied."""

    def __init__(self, node: Node) -> None:
        self._node = node
        self._parts: list[tuple[frozenset[str], Check, Apply]] = []
        node.add_pre_set_parameters_callback(self._as_declared)
        node.add_on_set_parameters_callback(self._check)
        node.add_post_set_parameters_callback(self._apply)

    def add(self, names: Iterable[str], apply: Apply, check: Check = lambda _: None) -> None:
        """Names of declared parameters, and what to do with new values of some of them, in the executor.

        check: raises MotionDetectError, whose words the user gets, for values that cannot be; nothing is changed then.
        """
        self._parts.append((frozenset(names), check, apply))

    def _as_declared(self, parameters: list[Parameter]) -> list[Parameter]:
        """A whole number stands for a float, as it does in files and on the command line."""
        return [Parameter(each.name, value=float(each.value)) if self._is_whole_float(each) else each
                for each in parameters]

    def _is_whole_float(self, given: Parameter) -> bool:
        declared = self._node.get_parameter_or(given.name, given)
        return type(given.value) is int and type(declared.value) is float

    def _check(self, parameters: list[Parameter]) -> SetParametersResult:
        for values, check, _ in self._concerned(parameters):
            try:
                check(values)
            except Exception as error:  # whatever it is, the old values hold
                return SetParametersResult(successful=False, reason=reason_of(error))
        return SetParametersResult(successful=True)

    def _apply(self, parameters: list[Parameter]) -> None:
        for values, _, apply in self._concerned(parameters):
            apply(values)

    def _concerned(self, parameters: list[Parameter]) -> Iterator[tuple[dict[str, Scalar], Check, Apply]]:
        for names, check, apply in self._parts:
            values = {each.name: each.value for each in parameters if each.name in names}
            if values:
                yield values, check, apply


def unknown_parameters(node: Node) -> dict[str, str]:
    """Names given on the command line or in a parameter file that no node of the package declares: misspelt, mostly.

    Each with the name it is closest to, empty where none is close. What another node declares is none, as one file
    serves all.
    """
    given = getattr(node, '_parameter_overrides', {})  # rclpy has no public way to ask
    known = {name for name, _, _ in settings(PipelineConfig())}
    unknown = [name for name in sorted(given)
               if not node.has_parameter(name) and not is_node_parameter(name) and name not in known]
    if unknown:
        known.update(node.get_parameters_by_prefix(''))
    return {name: next(iter(get_close_matches(name, known, 1)), '') for name in unknown}


def warn_of_unknown_parameters(node: Node) -> None:
    """Says each of ``unknown_parameters`` on the node's console."""
    for name, close in unknown_parameters(node).items():
        hint = f'; did you mean {close}?' if close else ''
        node.get_logger().warning(f'parameter {name} is unknown and has no effect{hint}')


def _declared(node: Node, name: str, default: Scalar, descriptor: ParameterDescriptor) -> Scalar:
    try:
        return node.declare_parameter(name, default, descriptor).value
    except InvalidParameterTypeException:
        given = node.declare_parameter(name, default, ParameterDescriptor(dynamic_typing=True)).value
        node.undeclare_parameter(name)
        if type(given) is not int or not isinstance(default, float | str):
            raise
        return node.declare_parameter(name, type(default)(given), descriptor, ignore_override=True).value


def _refusal(error: Exception, default: Scalar, low: float | None, high: float | None) -> str:
    kind = type(default).__name__
    limits = f' from {low} to {high}' if low is not None else ''
    return f'expected {kind}{limits}: {" ".join(str(error).split())}'


def _description(metadata: Mapping[str, Any]) -> str:
    unit = f' [{metadata["unit"]}]' if metadata.get('unit') else ''
    return f'{metadata["doc"]}{unit}'
