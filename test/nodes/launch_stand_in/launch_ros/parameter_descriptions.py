"""Parameters."""

from __future__ import annotations

from typing import Any


class ParameterValue:
    """A value that stays of its type."""

    def __init__(self, value: Any, *, value_type: type) -> None:
        self.value, self.value_type = value, value_type
