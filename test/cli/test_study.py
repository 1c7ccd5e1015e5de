"""`dlo_sim study`: refusals; what it writes is tested in test/studies/test_paper.py."""

import subprocess
import sys
from types import SimpleNamespace

from progress import rises, shown_progress

from dlo_sim.cli.main import main


def test_without_matplotlib_it_says_what_to_install(tmp_path):
    code = (
        "import sys; sys.modules['matplotlib'] = None\n"
        "from dlo_sim.cli.main import main\n"
        f"sys.exit(main(['study', 'paper', '--output', {str(tmp_path / 'new')!r}]))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 2
    assert "plots" in done.stderr
    assert done.stderr.count("\n") == 1
    assert not (tmp_path / "new").exists()


def test_progress_of_a_study_reaches_the_bar(tmp_path, monkeypatch, capsys):
    """Of a study that is made up; test/studies looks at those of the real ones."""

    def made_up(request):
        for fraction in (0.2, 0.4, 0.6, 0.8, 1.0):
            request.progress(fraction)
        return SimpleNamespace(report="report.md", verdicts={})

    module = SimpleNamespace(run_study=made_up)
    monkeypatch.setitem(sys.modules, "dlo_sim.studies.paper", module)
    shown = shown_progress(monkeypatch, "study")
    assert main(["study", "paper", "--output", str(tmp_path / "new")]) == 0
    assert rises(shown), shown
    assert capsys.readouterr().out == "report.md\n"
