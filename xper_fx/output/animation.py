# SPDX-License-Identifier: LGPL-3.0-or-later
"""An animation of the bodies of a run, written to a file while the run goes on."""

from __future__ import annotations

import logging
import os
from subprocess import CalledProcessError
from typing import Any

from xper_fx.output.frame_figures import draw_frame, frames_figure, look_of
from xper_fx.output.frames import Colour, take_frame
from xper_fx.simulation.simulation import Simulation
from xper_fx.support.checks import require_count, require_kind, require_path, require_positive
from xper_fx.support.files import explained

logger = logging.getLogger(__name__)

# What of `plot_frames` an animation takes.
_LOOK = ("window", "label", "limits", "chains", "view")
# Pixels an inch.
_DENSITY = 100


class Animation:
    """Films a simulation; a context manager.

    The first frame is that of the present, when it is made. No frame is kept in memory. A GIF is
    complete after each frame; an MP4 is once the animation is closed.

    **Limitation.** Checkpoints do not hold animations. A run that goes on from one films what is
    left of it: make the animation after the `Recorder`, and give its file another name.

    Args:
        path: of the file, `.gif` or `.mp4`; one that is there is replaced. MP4 needs ffmpeg.
        simulation: the run.
        colour: what colours the bodies, as `take_frame` takes it; a function is called for each
            frame.
        every: simulated time between frames (s).
        rate: frames a second of the film; a GIF counts in hundredths of a second.
        pixels: width of the picture.
        look: `window`, `label`, `limits`, `chains`, `view`, as `plot_frames` takes them. None as a
            window shows the bodies as they are at first. A colour bar needs `limits`.

    Attributes:
        frames: how many there are so far.

    Raises:
        ValueError: another format, ffmpeg is missing, a number out of range, as `take_frame`.
        TypeError: something of another kind than is expected, an unknown option.
        OSError: the file cannot be written.
        ImportError: matplotlib is missing.

    Example:
        >>> with xf.output.Animation("drum.gif", simulation, every=0.02) as film:
        ...     for step in simulation.steps(end_time=2.0):
        ...         film.record()
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        simulation: Simulation,
        colour: Colour = "group",
        *,
        every: float,
        rate: float = 25.0,
        pixels: int = 640,
        **look: Any,
    ):
        self.path = require_path("path", path)
        require_kind("simulation", simulation, Simulation)
        if unknown := sorted(set(look) - set(_LOOK)):
            raise TypeError(f"An animation takes {', '.join(_LOOK)}; got {', '.join(unknown)}.")
        self._every, self._next = require_positive("every", every), simulation.time
        require_positive("rate", rate)
        if rate > 100.0:
            raise ValueError(f"rate should be at most 100 frames a second, got {rate:g}.")
        require_count("pixels", pixels, 100)
        writer = _writer(self.path.suffix.lower(), rate)
        self._simulation, self._colour, self.frames = simulation, colour, 0
        self._start, self._closed = simulation.time, False
        frame = take_frame(simulation, colour)
        label = look.get("label") or frame.label
        if label is not None and look.get("limits") is None:
            raise ValueError(
                f'The colours of "{label}" need limits for all frames: give limits=(low, high).'
            )
        self._look = look_of([frame], **look)
        self._writer, self._at_first_rank = writer, simulation.team.rank == 0
        self._at_root = simulation.team.at_root

        def begin() -> None:
            self._figure = frames_figure(
                [frame], self._look, None, (1, 1), pixels / _DENSITY, label
            )
            self._figure.draw_without_rendering()
            self._figure.set_layout_engine("none")  # else a title would move the picture
            with explained(self.path):
                writer.setup(self._figure, self.path, _DENSITY)

        self._at_root(begin)
        self.record()

    def record(self) -> None:
        """Add a frame if one is due; to be called after each step, by all ranks together.

        Raises:
            ValueError: the animation is closed.
            OSError: the file cannot be written.
        """
        simulation = self._simulation
        if self._closed:
            raise ValueError(f"The animation '{self.path}' is closed.")
        if simulation.time < self._next * (1.0 - 1e-9):
            return
        self._next = max(self._next + self._every, simulation.time)
        with simulation.stopwatch.phase("animation"):
            frame = take_frame(simulation, self._colour)
            self._at_root(lambda: self._add(frame))
        self.frames += 1

    def _add(self, frame: Any) -> None:
        draw_frame(self._figure.axes[0], frame, self._look)
        with explained(self.path):
            self._writer.grab_frame()

    def close(self) -> None:
        """Finish the file.

        Raises:
            OSError: ffmpeg failed.
        """
        if self._closed:
            return
        self._closed = True
        self._at_root(self._finish)
        if self.frames == 1 and self._simulation.time > self._start and self._at_first_rank:
            logger.warning(
                "%s holds the first frame alone: call record() after each step, every %g s",
                self.path,
                self._every,
            )

    def _finish(self) -> None:
        try:
            self._writer.finish()
        except CalledProcessError as error:
            raise OSError(f"'{self.path}' could not be written: ffmpeg failed ({error}).") from None

    def __enter__(self) -> Animation:
        return self

    def __exit__(self, *exception: object) -> None:
        self.close()


def _writer(suffix: str, rate: float) -> Any:
    """A writer of Matplotlib for a format."""
    if suffix == ".gif":
        from xper_fx.plotting.gif_writer import GifWriter

        return GifWriter(fps=rate)
    if suffix == ".mp4":
        from matplotlib.animation import FFMpegWriter

        if not FFMpegWriter.isAvailable():
            raise ValueError(
                "An animation in .mp4 needs the program ffmpeg, which is not installed: install it "
                "(apt install ffmpeg, conda install ffmpeg), or write a .gif."
            )
        return FFMpegWriter(fps=rate)
    raise ValueError(f"An animation is a .gif or an .mp4 file, got the suffix {suffix!r}.")
