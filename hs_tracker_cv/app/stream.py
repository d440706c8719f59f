"""Pictures of a video that plays: straight into an image of the page, as fast as the browser shows them."""

from __future__ import annotations

import asyncio
import contextlib
import time

from nicegui import background_tasks, ui
from nicegui.elements.interactive_image import InteractiveImage

__all__ = ["SCRIPT", "Stream"]

AHEAD = 3
"""Pictures that may be on their way at once: one is shown while another is decoded and the next one sent."""
PATIENCE = 2.0
"""Seconds after which a picture counts as shown whatever the browser says."""
SPAN = 2.0
"""Seconds over which the rate is taken."""

SCRIPT = """
<script>
  // An image's new picture; fulfilled when it is on the screen. Nobody sees a hidden page, and it draws nothing.
  window.hsShow = (id, url) => new Promise((shown) => {
    const image = document.querySelector(`#c${id} img`);
    const loaded = () => document.hidden ? shown(false) : requestAnimationFrame(() => shown(true));
    image.addEventListener("load", loaded, { once: true });
    image.src = url;
  });
</script>
"""
"""For the head of the page."""


class Stream:
    """Sends pictures to an image past the page's elements, of which any change makes the browser compare all.

    Parameters
    ----------
    image : InteractiveImage
    """

    def __init__(self, image: InteractiveImage) -> None:
        self._image = image
        self._client = ui.context.client
        self._under_way: set[asyncio.Task[None]] = set()
        self._times: list[float] = []

    async def send(self, url: str) -> None:
        """Send a picture, once the browser has shown what was sent before but for a little."""
        while len(self._under_way) >= AHEAD:
            await asyncio.wait(self._under_way, return_when=asyncio.FIRST_COMPLETED)
        task = background_tasks.create(self._shown(url), name="stream")
        self._under_way.add(task)
        task.add_done_callback(self._under_way.discard)

    async def settle(self) -> None:
        """Wait until nothing is under way: it would come after, and on top of, what is shown otherwise."""
        if self._under_way:
            await asyncio.wait(self._under_way)

    async def _shown(self, url: str) -> None:
        with contextlib.suppress(TimeoutError):
            code = f'hsShow({self._image.id}, "{url}")'
            if await self._client.run_javascript(code, timeout=PATIENCE):
                self._times.append(time.monotonic())

    def begin(self) -> None:
        """Count from here on."""
        self._times = []

    @property
    def rate(self) -> float:
        """Pictures per second that were on the screen lately; 0 while that cannot be said."""
        now = time.monotonic()
        self._times = [moment for moment in self._times if now - moment < SPAN]
        if len(self._times) < 5:
            return 0.0
        return (len(self._times) - 1) / (self._times[-1] - self._times[0])
