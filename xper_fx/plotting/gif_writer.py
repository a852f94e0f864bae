# SPDX-License-Identifier: LGPL-3.0-or-later
"""Writes GIF frame by frame, where Matplotlib's own writer keeps all frames until the end.

A writer of Matplotlib, for `matplotlib.animation` too. After each frame the file is complete: it
can be looked at while the run goes on and after it was killed. A frame holds the pixels that differ
from the last one, with up to 127 colours of its own.
"""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
from matplotlib.animation import AbstractMovieWriter
from matplotlib.figure import Figure
from PIL import GifImagePlugin, Image

from xper_fx.support.files import explained

# Colours of a frame: more make files larger. What ends a file.
_COLOURS, _END = 127, b";"


class GifWriter(AbstractMovieWriter):
    """Frames of a figure as a GIF that repeats.

    Args:
        fps: frames a second, in whole hundredths of a second: 25 is 25, 30 is 33.3.
    """

    def setup(self, fig: Figure, outfile: str | Path, dpi: float | None = None) -> None:
        """Begin the file.

        Raises:
            OSError: it cannot be written.
        """
        with explained(outfile):
            super().setup(fig, outfile, dpi)
            self._file = open(outfile, "wb")  # noqa: SIM115 - closed by `finish`
        self._last: np.ndarray | None = None

    def grab_frame(self, **savefig_kwargs: object) -> None:
        """Add the figure as it is.

        Raises:
            OSError: the disk is full.
        """
        drawn = io.BytesIO()
        self.fig.savefig(drawn, format="rgba", dpi=self.dpi, **savefig_kwargs)
        size = self.frame_size
        image = Image.frombuffer("RGBA", size, drawn.getbuffer(), "raw", "RGBA", 0, 1)
        image = image.convert("RGB")
        now, indexed = np.asarray(image), image.quantize(_COLOURS, dither=Image.Dither.NONE)
        shown = {"duration": round(100.0 / self.fps) * 10, "include_color_table": True}
        if self._last is None:
            parts, _ = GifImagePlugin.getheader(indexed, info={"loop": 0})
        else:
            parts = []
            same = len(indexed.getpalette()) // 3  # a colour more, which shows the last frame
            pixels = np.where((now == self._last).all(axis=2), same, np.asarray(indexed))
            changed = Image.fromarray(pixels.astype(np.uint8), "P")
            changed.putpalette(indexed.getpalette() + [0, 0, 0])
            indexed = changed
            shown |= {"transparency": same, "disposal": 1}
        parts += GifImagePlugin.getdata(indexed, **shown)
        with explained(self.outfile):
            if self._last is not None:
                self._file.seek(-len(_END), io.SEEK_END)
            self._file.write(b"".join(parts) + _END)
            self._file.flush()
        self._last = now

    def finish(self) -> None:
        """Close the file."""
        self._file.close()
