"""Trackers of several objects that `test_eval_mot.py` has judged."""

from __future__ import annotations

from typing import Any


class Blind:
    """Sees nothing."""

    def update(self, image: Any) -> list[Any]:
        """Nothing."""
        return []


class Wrong:
    """Answers with boxes that belong to nobody."""

    def update(self, image: Any) -> list[Any]:
        """Four numbers."""
        return [(1.0, 2.0, 3.0, 4.0)]
