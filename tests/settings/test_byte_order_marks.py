"""Files that Windows saved begin with a byte order mark."""

from pathlib import Path

from glsim.core.files.regular import read_csv
from glsim.settings.schema import load_settings
from glsim.settings.toml_tables import read_toml


def test_byte_order_marks_and_comments_are_skipped(tmp_path: Path) -> None:
    toml, table = tmp_path / "a.toml", tmp_path / "a.csv"
    toml.write_bytes(b"\xef\xbb\xbfseed = 5 # a note\r\n")
    assert read_toml(toml) == {"seed": 5}
    assert load_settings(toml).seed == 5
    table.write_bytes(b"\xef\xbb\xbf# of a run\r\nmethod,mean\r\n\r\n# more\r\nnoisy,2.5\r\n")
    assert read_csv(table) == [{"method": "noisy", "mean": "2.5"}]
