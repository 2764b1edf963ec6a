"""The notebook, cell after cell; those that need more than this package where that is installed."""

import json
import os
from pathlib import Path

from conftest import PROGRAM

NOTEBOOK = Path(__file__).parents[2] / "examples" / "quickstart.ipynb"


def test_the_quickstart_runs(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PATH", f"{PROGRAM.parent}{os.pathsep}{os.environ['PATH']}")
    monkeypatch.setenv("MPLBACKEND", "Agg")
    code = [cell for cell in json.loads(NOTEBOOK.read_text())["cells"] if cell["cell_type"] == "code"]
    optional = [cell for cell in code if "optional" in cell["metadata"].get("tags", [])]
    assert (len(code), len(optional)) == (9, 3)
    names = {}
    for cell in code:
        source = compile("".join(cell["source"]), "cell", "exec")
        try:
            exec(source, names)
        except ModuleNotFoundError as missing:
            assert cell in optional and missing.name in ("evo", "matplotlib", "rerun")
    assert names["errors"]["ate"]["rmse"] < 0.1
    assert names["found"].relied_on.mean() > 0.5
    assert names["ends"].shape == (len(names["result"].map), 2, 2)
    assert (tmp_path / "out" / "map.png").is_file()
    assert "consistent" in capsys.readouterr().out
