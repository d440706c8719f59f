"""`TrackerHS_Params`: the options a user may set, in the style of cv2's ``Params`` structs."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields
from typing import Any, Literal, get_args

from .scalars import plain
from .validation import shown

__all__ = ["MODES", "TrackerHS_Params"]

Mode = Literal["auto", "segmentation", "patch_tracker"]
MODES: tuple[Mode, ...] = get_args(Mode)
"""Values of `TrackerHS_Params.mode`."""


@dataclass(slots=True)
class TrackerHS_Params:  # cv2's own naming: TrackerCSRT_Params
    """Options of :class:`~hs_tracker_cv.TrackerHS`; mutable, like cv2's.

    Parameters
    ----------
    mode : {"auto", "segmentation", "patch_tracker"}
        How the box is found. ``"auto"`` lets the tracker choose from frame to frame; the others fix it.
    rotation : bool
        Let the box that is carried by flow turn with the object, and answer with the upright box round the turned
        one. Segmentation follows rotation in any case.
    gain : float or None
        Gray levels (of 255) per unit of frames that are not 8-bit, above 0. None takes the range of the first frame,
        with headroom; either holds for the whole track.

    Raises
    ------
    TypeError
        When a field is set to a value of another type; NumPy's numbers become Python's.
    ValueError
        When a value is outside its range.
    AttributeError
        When an unknown field is set.

    Examples
    --------
    >>> parameters = TrackerHS_Params(mode="patch_tracker")
    >>> TrackerHS_Params.from_dict(parameters.to_dict()) == parameters
    True
    """

    mode: Mode = "auto"
    rotation: bool = False
    gain: float | None = None

    def __setattr__(self, name: str, value: Any) -> None:
        kinds = {field.name: str(field.type) for field in fields(self)}
        if name not in kinds:
            raise AttributeError(f"TrackerHS_Params has no field {name!r}; its fields are {', '.join(kinds)}")
        value = plain(name, value, kinds[name])
        _check_range(name, value)
        object.__setattr__(self, name, value)

    def __reduce__(self) -> tuple[Any, ...]:
        # Of a class with slots pickle's oldest protocols know nothing by themselves.
        return type(self).from_dict, (self.to_dict(),)

    def to_dict(self) -> dict[str, Any]:
        """All fields by name."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: dict[str, Any]) -> TrackerHS_Params:
        """Build from a mapping of field names; missing ones keep their defaults.

        Raises
        ------
        AttributeError
            For an unknown name.
        """
        parameters = cls()
        for name, value in values.items():
            setattr(parameters, name, value)
        return parameters


def _check_range(name: str, value: Any) -> None:
    if name == "mode" and not isinstance(value, str):
        raise TypeError(f"expected mode to be a str, got {shown(value)}")
    if name == "mode" and value not in MODES:
        raise ValueError(f"expected mode to be one of {', '.join(MODES)}, got {shown(value)}")
    if name == "gain" and value is not None and not 0.0 < value < math.inf:
        raise ValueError(f"expected a finite gain above 0, got {value!r}")
