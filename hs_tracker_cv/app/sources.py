"""What a page may open: what was named when it was started, and what its user hands over; nothing else."""

from __future__ import annotations

import itertools
import tempfile
from dataclasses import replace
from pathlib import Path
from urllib.parse import urlsplit

from ..video import IMAGE_SUFFIXES, VIDEO_SUFFIXES, VideoError, VideoSource, natural_key, open_source, source_kind
from .demo import demo

__all__ = ["CAMERA", "DEMO", "Sources", "require"]

DEMO = "a rolling ball (demo)"
CAMERA = "camera {}"


class Sources:
    """The sources of one page, by the names under which it offers them.

    Parameters
    ----------
    named : str
        A video file, the number of a camera, a folder of images or a folder of videos; empty for none. The first
        camera and a small synthetic sequence are offered in any case.

    Attributes
    ----------
    names : list of str
        In the order in which they are offered.
    """

    def __init__(self, named: str = "") -> None:
        self.names: list[str] = []
        self._paths: dict[str, str] = {}
        self._inbox = tempfile.TemporaryDirectory(prefix="hs-track-upload-")
        self._uploads = itertools.count()
        kind, root = source_kind(named) if named else "", Path(named)
        if kind == "folder":
            self._add_folder(root)
        elif kind == "camera":
            self._add(CAMERA.format(named.removeprefix("/dev/video")), named)
        elif kind == "stream":
            # By what is no secret: neither user and password nor query.
            parts = urlsplit(named)
            self._add(Path(parts.path).name or parts.hostname or parts.scheme, named)
        elif kind == "file":
            # Absolute, so that a file called 0 is no camera.
            self._add(root.name or named, str(root.resolve()) if root.exists() else named)
        if CAMERA.format(0) not in self._paths:
            self._add(CAMERA.format(0), "0")
        self.names.append(DEMO)

    def _add(self, name: str, path: str) -> str:
        unique = next(text for text in _numbered(name) if text not in self._paths)
        self._paths[unique] = path
        self.names.append(unique)
        return unique

    def _add_folder(self, folder: Path) -> None:
        inside = _listed(folder)
        videos = _videos_of(inside, folder)
        if not videos or any(path.suffix.lower() in IMAGE_SUFFIXES for path in inside):
            # With the name of its parent: many data sets call every such folder img.
            self._add("/".join(folder.resolve().parts[-2:]), str(folder.absolute()))
        for path in videos:
            self._add(path.name, str(path.resolve()))

    def open(self, name: str) -> VideoSource:
        """Open one of `names`.

        Raises
        ------
        VideoError
            If it is none of them, or cannot be read.
        """
        if name == DEMO:
            return demo()
        if name not in self._paths:
            raise VideoError(f"{name}: is not among the videos of this page ({', '.join(self.names)})")
        path = self._paths[name]
        if not self.is_upload(name):
            return open_source(path)
        # The viewer knows the file by its own name, in messages and in the names of what is taken away.
        try:
            return replace(open_source(path), name=Path(name).stem)
        except VideoError as error:
            raise VideoError(str(error).replace(path, name)) from error

    def is_upload(self, name: str) -> bool:
        """Whether a source has been handed over in the browser."""
        return name in self._paths and Path(self._paths[name]).is_relative_to(self._inbox.name)

    def argument(self, name: str) -> str:
        """How a source is named on a command line; a placeholder for what the page alone has."""
        path = self._paths.get(name, "")
        return path if path and not self.is_upload(name) else name

    def reserve(self, name: str) -> tuple[str, Path]:
        """Make room for an upload: the name under which it is offered, and the file to write it to.

        Parameters
        ----------
        name : str
            As the browser tells it; used for nothing but the ending and as a text.

        Raises
        ------
        VideoError
            If its ending is not that of a video.
        """
        plain = name.replace("\\", "/").rsplit("/", 1)[-1]
        suffix = Path(plain).suffix.lower()
        if suffix not in VIDEO_SUFFIXES:
            raise VideoError(f"{plain}: expected a video ({', '.join(sorted(VIDEO_SUFFIXES))})")
        path = Path(self._inbox.name) / f"upload{next(self._uploads)}{suffix}"
        return self._add(plain, str(path)), path

    def close(self) -> None:
        """Delete the uploads."""
        self._inbox.cleanup()


def require(named: str) -> None:
    """Refuse a file or folder that cannot be used, before a page is served for it.

    Cameras and streams are left to the page: what they need may still come.

    Raises
    ------
    VideoError
        With the reason.
    """
    kind, path = source_kind(named) if named else "", Path(named)
    # Opened once more by the page: a pipe would be empty by then.
    if kind == "folder" or (kind == "file" and (path.is_file() or not path.exists())):
        if not (kind == "folder" and _videos_of(_listed(path), path)):
            open_source(path).close()


def _listed(folder: Path) -> list[Path]:
    try:
        return sorted(folder.iterdir(), key=natural_key)
    except OSError:
        return []


def _videos_of(inside: list[Path], folder: Path) -> list[Path]:
    return [path for path in inside if path.suffix.lower() in VIDEO_SUFFIXES and _lies_in(path, folder)]


def _lies_in(path: Path, folder: Path) -> bool:
    """Whether a path still lies in a folder, and is a file there, when all links are followed."""
    real = path.resolve()
    return real.is_file() and real.is_relative_to(folder.resolve())


def _numbered(name: str) -> itertools.chain[str]:
    return itertools.chain([name], (f"{name} ({number})" for number in itertools.count(2)))
