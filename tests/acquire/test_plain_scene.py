"""A scene in which blind separation has nothing to hold on to."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from acquire.cli.progress import ProgressDisplay
from acquire.errors import StackError
from acquire.pipeline import Options, process
from acquire.table import import_table
from processing.patterns import Family, Pattern


def test_a_plain_white_wall_is_refused_in_words(tmp_path: Path) -> None:
    lines = ["file,role,pattern,pitch_px,shift_y_px,shift_x_px"]
    scene = np.full((16, 24, 3), 200.0)

    def picture(name: str, light: np.ndarray, rest: str) -> None:
        Image.fromarray(np.rint(light).astype(np.uint8)).save(tmp_path / name)
        lines.append(f"{name},{rest}")

    picture("w.png", scene, "white,,,,")
    picture("b.png", 0 * scene, "black,,,,")
    for pitch_px in (4, 8):
        for shift in range(2 * pitch_px):
            code = Pattern(Family.STRIPES_COLUMNS, pitch_px, 0, shift).code((16, 24))
            name = f"{pitch_px}-{shift}.png"
            rest = f"pattern,stripes-columns,{pitch_px},0,{shift}"
            picture(name, scene * code[..., np.newaxis], rest)
    (tmp_path / "t.csv").write_text("\n".join(lines) + "\n")
    with ProgressDisplay(quiet=True) as progress:
        session = import_table(
            tmp_path / "t.csv", tmp_path / "s", transfer="linear", progress=progress
        )
        with pytest.raises(StackError, match="nothing to hold on to"):
            process(session, tmp_path / "r", Options(method="iva", n_components=2), progress)
