import subprocess
import sys


def test_import_loads_nothing_heavy():
    code = (
        "import sys, gramian; heavy = {'matplotlib', 'scipy', 'pydantic', 'typer', 'rich', "
        "'jinja2', 'pandas', 'pyarrow'} & set(sys.modules); sys.exit(','.join(heavy) or 0)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
