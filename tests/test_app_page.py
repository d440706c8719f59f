"""In which order the page does what is asked of it, without a browser."""

from __future__ import annotations

import asyncio
import types
from typing import Any

import pytest

pytest.importorskip("nicegui")

from hs_tracker_cv.app.page import DRAG, WAITING, Page
from hs_tracker_cv.geometry import Box
from hs_tracker_cv.video import VideoError


class _Text:
    """A label."""

    def __init__(self) -> None:
        self.text = ""

    def set_text(self, text: str) -> None:
        self.text = text


def _page(**parts: Any) -> Any:
    """What a page's methods need of it, without elements."""
    page = types.SimpleNamespace(
        session=types.SimpleNamespace(opened=True, index=0),
        grid=types.SimpleNamespace(refresh=lambda: None),
        picker=types.SimpleNamespace(clear=lambda: None),
        hint=_Text(),
        goal=None,
        asked=0,
        finder=None,
        playing=False,
        left=False,
        moving=asyncio.Lock(),
        turn=asyncio.Lock(),
    )

    def play(playing: bool) -> None:
        page.finder, page.playing = None, playing

    async def nothing(*_: Any) -> None:
        await asyncio.sleep(0)

    page._play = play
    page._render, page._show = lambda: None, nothing
    page._advance = None
    page._aim = lambda: Page._aim(page)
    page._halt = lambda: Page._halt(page)
    page._search = lambda finder: Page._search(page, finder)
    page.pursue = lambda goal: Page.pursue(page, goal)
    page.catch_up = lambda: Page.catch_up(page)
    vars(page).update(parts)
    return page


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
            await page.pursue(7)

    page = _page(do=do, _show=show)
    asyncio.run(page.pursue(7))
    assert goals == [7, 7]
    assert (page.goal, page.moving.locked()) == (None, False)


def test_catching_up_leaves_the_way_to_a_frame_as_it_is() -> None:
    """A tracker ticked while the page goes to frame 9 does not bring it back to where it is at that moment."""
    goals: list[int] = []

    async def do(_: Any, goal: int) -> tuple[bool, str]:
        goals.append(goal)
        if len(goals) == 1:
            await page.catch_up()
        page.session.index = goal
        return True, "a picture"

    page = _page(do=do)
    asyncio.run(page.pursue(9))
    assert goals == [9, 9]
    assert page.session.index == 9


def test_a_pause_ends_the_way_to_a_frame() -> None:
    """Where it is when a box is begun, there it stays."""
    goals: list[int] = []

    async def do(_: Any, goal: int) -> tuple[bool, str]:
        goals.append(goal)
        page._halt()
        return False, "a picture"

    page = _page(do=do)
    asyncio.run(page.pursue(9))
    assert goals == [9]


def test_a_frame_asked_for_while_there_was_none_is_gone_to() -> None:
    """The first frame of a video that has just been opened is not lost to what came back empty from before."""
    goals: list[int] = []

    async def do(_: Any, goal: int) -> tuple[bool, str | None]:
        goals.append(goal)
        if len(goals) == 1:
            await page.pursue(0)
            return True, None
        return True, "a picture"

    page = _page(do=do)
    asyncio.run(page.pursue(5))
    assert goals == [5, 0]


def test_of_two_videos_chosen_at_once_the_last_is_opened() -> None:
    """Once, and neither calls the other back."""
    opened: list[str] = []
    goals: list[int] = []

    async def do(_: Any, name: str) -> bool:
        await asyncio.sleep(0)
        opened.append(name)
        return True

    async def pursue(goal: int) -> None:
        goals.append(goal)

    async def choose() -> None:
        page = _page(do=do, pursue=pursue, name=types.SimpleNamespace(value="b"))
        page.session.open = None
        await asyncio.gather(Page.open(page, "a"), Page.open(page, "b"))
        assert page.hint.text == DRAG

    asyncio.run(choose())
    assert (opened, goals) == (["b"], [0])


def test_a_frame_of_a_video_that_is_closed_is_not_shown() -> None:
    """It was drawn while another one was opened."""
    shown = types.SimpleNamespace(moment="of another video", index=3)
    page = _page(shown=None)
    page.session.shows = lambda moment: False
    asyncio.run(Page._show(page, shown))
    assert page.shown is None


def _searching(found_at: int) -> Any:
    """A page whose search for a mover takes a step a call, and finds one in that frame."""

    async def do(work: Any, *args: Any) -> bool:
        await asyncio.sleep(0)
        if work == "search":
            page.session.index += 1
            finders.append(args[0])
            return bool(page.session.index >= found_at)
        page.session.index = args[0]
        return True

    async def advance(work: Any, *args: Any) -> Any:
        result = await do(work, *args)
        return result if work == "search" else (True, "a picture")

    finders: list[Any] = []
    page = _page(do=advance, finders=finders)
    page.session.follow_first_mover = "search"
    page._render = lambda: "a picture"
    return page


def test_a_second_search_takes_the_place_of_the_first() -> None:
    """Each frame is looked at once, and the video plays when one has found something."""

    async def press() -> Any:
        page = _searching(6)
        await asyncio.gather(Page.follow_first(page), Page.follow_first(page))
        return page

    page = asyncio.run(press())
    assert (page.session.index, page.playing) == (6, True)
    # The first took a step at most before it was told; the second has a finder of its own.
    assert len(page.finders) == 6
    assert len({id(finder) for finder in page.finders[1:]}) == 1


def test_another_frame_ends_the_search() -> None:
    """Whoever goes to a frame while it searches gets there, and nothing plays."""

    async def press() -> Any:
        page = _searching(10**6)

        async def step() -> None:
            while page.session.index < 5:
                await asyncio.sleep(0)
            page._play(False)
            await page.pursue(2)

        await asyncio.gather(Page.follow_first(page), step())
        return page

    page = asyncio.run(press())
    assert (page.session.index, page.playing, page.finder, page.goal) == (2, False, None, None)
    assert page.hint.text == DRAG != WAITING


def test_a_refused_choice_is_not_left_ticked() -> None:
    """Controls show what holds, whatever was asked for."""
    from hs_tracker_cv.app.controls import Controls

    class Choice:
        def __init__(self, value: Any) -> None:
            self.value = value

        def set_value(self, value: Any) -> None:
            self.value = value

    async def change(*_: Any) -> None:
        return None

    controls: Any = types.SimpleNamespace(
        _page=types.SimpleNamespace(change=change),
        _session=types.SimpleNamespace(
            names=["TrackerHS"], choose=None, parameters=types.SimpleNamespace(mode="auto", rotation=False)
        ),
        _chosen={"TrackerHS": Choice(True), "TrackerNano": Choice(True)},
        _mode=Choice("auto"),
        _rotation=Choice(False),
    )
    controls._show_what_holds = lambda: Controls._show_what_holds(controls)
    asyncio.run(Controls._choose(controls))
    assert {name: box.value for name, box in controls._chosen.items()} == {"TrackerHS": True, "TrackerNano": False}


def test_panels_of_a_video_that_was_closed_meanwhile_are_no_error() -> None:
    """They are left out; the next ones come with its successor. Other errors are told."""
    from hs_tracker_cv.app.panels import PanelGrid

    def panels(*_: Any) -> None:
        raise VideoError("no")

    for open_still in (False, True):
        session = types.SimpleNamespace(current=lambda: "seen", panels=panels, shows=lambda seen, s=open_still: s)
        grid: Any = types.SimpleNamespace(_page=types.SimpleNamespace(session=session))
        if open_still:
            with pytest.raises(VideoError):
                PanelGrid._panels(grid, ["Fx"])
        else:
            assert PanelGrid._panels(grid, ["Fx"]) == {}


def test_where_a_box_was_drawn_there_the_page_stays() -> None:
    """Though it was on its way, and further by the time at which the box is taken."""
    goals: list[int] = []

    async def change(_: Any) -> bool:
        return True

    async def pursue(goal: int) -> None:
        goals.append(goal)

    page = _page(change=change, pursue=pursue)
    page.shown = types.SimpleNamespace(moment=types.SimpleNamespace(index=5))
    page.controls = types.SimpleNamespace(several=types.SimpleNamespace(value=False))
    page.session = types.SimpleNamespace(opened=True, index=7, start=lambda *_: None, names=["TrackerHS"])
    asyncio.run(Page._boxed(page, Box(1, 2, 30, 40)))
    assert goals == [5]
    assert page.hint.text == "box 1, 2, 30, 40 at frame 5"
