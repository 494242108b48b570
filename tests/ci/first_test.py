"""Writes the files of the section "A first test" of docs/python.md, as a reader types them.

usage: first_test.py PAGE FOLDER
"""

import re
import sys
from pathlib import Path

page, folder = Path(sys.argv[1]).read_text(encoding="utf-8"), Path(sys.argv[2])
section = page.split("## A first test\n")[1].split("\n## ")[0]
names = re.findall(r"`(\w+\.(?:toml|py))`(?: | is |:)", section)
blocks = re.findall(r"```(?:toml|python)\n(.*?)```", section, re.S)
assert len(blocks) == 3 and len(names) == 3, (names, len(blocks))
for name, block in zip(names, blocks):
    (folder / name).write_text(block, encoding="utf-8")
