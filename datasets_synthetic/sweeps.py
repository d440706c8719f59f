"""One parameter of drawn sequences set to a value, all else as it was drawn: what suites of a sweep are made by."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

from .draft import Draft
from .spec import Effect

__all__ = ["SWEEPS", "Sweep"]

_HIDDEN_AT = 20  # frame at which the object goes
_BACK = 25  # frames after it has come back


@dataclass(frozen=True)
class Sweep:
    """A parameter that can be set.

    Parameters
    ----------
    title : str
        What it is, with its unit: the axis of a plot.
    low, high : float
        What it may be.
    put : callable
        (draft, value): sets it.
    """

    title: str
    low: float
    high: float
    put: Callable[[Draft, float], None]

    def setting(self, value: float) -> Callable[[Draft], None]:
        """Return what sets it to a value in a draft.

        Raises
        ------
        ValueError
            If it cannot be that.
        """
        if not self.low <= value <= self.high:
            raise ValueError(f"expected {self.title} in {self.low:g}–{self.high:g}, got {value:g}")

        def put(draft: Draft) -> None:
            self.put(draft, value)

        return put


def _replace_effect(draft: Draft, kind: str, strength: float) -> None:
    draft.effects = [effect for effect in draft.effects if effect.kind != kind]
    draft.effects.append(Effect(kind, strength))


def _noise(draft: Draft, value: float) -> None:
    draft.noise = value


def _rotation(draft: Draft, value: float) -> None:
    draft.spin = value


def _speed(draft: Draft, value: float) -> None:
    draft.speed = value * draft.unit


def _size(draft: Draft, value: float) -> None:
    scale = value * draft.unit / max(draft.size)
    draft.size = (round(draft.size[0] * scale, 2), round(draft.size[1] * scale, 2))


def _contrast(draft: Draft, value: float) -> None:
    _replace_effect(draft, "haze", round(1.0 - value, 6))


def _blur(draft: Draft, value: float) -> None:
    draft.shutter = value


def _compression(draft: Draft, value: float) -> None:
    _replace_effect(draft, "jpeg", value)


def _occlusion(draft: Draft, value: float) -> None:
    frames = round(value)
    draft.blanks, draft.rests = (), ()
    draft.frames = max(draft.frames, _HIDDEN_AT + frames + _BACK)
    draft.hidden = ((_HIDDEN_AT, _HIDDEN_AT + frames),) if frames else ()


SWEEPS: dict[str, Sweep] = {
    "noise": Sweep("noise, grey levels (deviation)", 0.0, 100.0, _noise),
    "rotation": Sweep("rotation rate, degrees per frame", -180.0, 180.0, _rotation),
    "speed": Sweep("speed, px per frame of 320 px", 0.05, 60.0, _speed),
    "size": Sweep("longer side, px in a frame of 320 px", 4.0, 200.0, _size),
    "contrast": Sweep("contrast, share of the full one", 0.02, 1.0, _contrast),
    "blur": Sweep("exposure, share of the time between frames", 0.0, 1.0, _blur),
    "compression": Sweep("JPEG quality", 1.0, 100.0, _compression),
    "occlusion": Sweep("occlusion, frames out of sight", 0.0, 200.0, _occlusion),
}
"""Name -> what can be set in every theme."""
