"""In which order the page does what is asked of it, without a browser."""

from __future__ import annotations

import asyncio
import types
from typing import Any

import pytest

pytest.importorskip("nicegui")

from hs_tracker_cv.app.page import Page


def _page(**parts: Any) -> Any:
    """What a page's methods need of it, without elements."""
    return types.SimpleNamespace(
        session=types.SimpleNamespace(opened=True),
        grid=types.SimpleNamespace(refresh=lambda: None),
        goal=None,
        asked=0,
        pursuing=False,
        left=False,
        turn=asyncio.Lock(),
        **parts,
    )


def test_changes_are_made_in_the_order_in_which_they_were_asked_for() -> None:
    """The first takes longest, and is still the first to be done."""
    done: list[int] = []

    async def do(work: int) -> int:
        await asyncio.sleep(0.02 if work == 0 else 0.0)
        done.append(work)
        return work

    async def click() -> list[int]:
        page = _page(do=do)
        return await asyncio.gather(*(Page.change(page, work) for work in range(5)))

    assert asyncio.run(click()) == done == [0, 1, 2, 3, 4]


def test_a_frame_asked_for_again_while_it_is_shown_is_gone_to_again() -> None:
    """A tracker that is ticked while the last frame of a way is being shown has not been there: one more round."""
    goals: list[int] = []

    async def do(_: Any, goal: int) -> tuple[bool, str]:
        goals.append(goal)
        return True, "a picture"

    async def show(_: str) -> None:
        if len(goals) == 1:
            await Page.pursue(page, 7)

    page = _page(do=do, _advance=None, _show=show)
    asyncio.run(Page.pursue(page, 7))
    assert goals == [7, 7]
    assert (page.goal, page.pursuing) == (None, False)
