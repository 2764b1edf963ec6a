"""The notebook, cell after cell, but for those that need more than this package."""

import json
import os
from pathlib import Path

from conftest import PROGRAM

NOTEBOOK = Path(__file__).parents[2] / "examples" / "quickstart.ipynb"


def test_the_quickstart_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{PROGRAM.parent}{os.pathsep}{os.environ['PATH']}")
    code = [cell for cell in json.loads(NOTEBOOK.read_text())["cells"] if cell["cell_type"] == "code"]
    required = [cell for cell in code if "optional" not in cell["metadata"].get("tags", [])]
    assert len(required) == 5 and len(code) == 7
    names = {}
    for cell in required:
        exec("".join(cell["source"]), names)
    assert names["errors"]["ate"]["rmse"] < 0.1
    assert names["found"].relied_on.mean() > 0.5
    assert (tmp_path / "out" / "map.png").is_file()
    assert "consistent" in capsys.readouterr().out
    for cell in code:
        compile("".join(cell["source"]), "cell", "exec")
