"""Frames from a video file, a stream, a camera or a folder of images; video out.

Whatever goes wrong with a source or a target is one :class:`VideoError` of one line. An error in the middle of
a source is raised where it happens, after every frame before it has been handed out, so the caller keeps what
it has. What the decoders print themselves is left to OpenCV's own switches (``cv2.setLogLevel``, the environment's
``OPENCV_LOG_LEVEL`` and ``OPENCV_FFMPEG_LOGLEVEL``): standard error belongs to the whole process.
"""

from __future__ import annotations

from .folder import IMAGE_SUFFIXES, image_files, natural_key, read_image
from .opening import VIDEO_SUFFIXES, open_source, source_kind
from .quiet import silence_decoders
from .sink import CODECS, VideoSink
from .source import VideoError, VideoSource, native_name

__all__ = [
    "CODECS",
    "IMAGE_SUFFIXES",
    "VIDEO_SUFFIXES",
    "VideoError",
    "VideoSink",
    "VideoSource",
    "image_files",
    "native_name",
    "natural_key",
    "open_source",
    "read_image",
    "silence_decoders",
    "source_kind",
]
