"""Prints the shell commands of a CI file, one step a line, what is in its braces filled in.

usage: steps.py FILE [NAME=VALUE ..]
"""

import re
import shlex
import sys

import yaml

path, *values = sys.argv[1:]
inputs = dict(value.split("=", 1) for value in values)
with open(path, encoding="utf-8") as file:
    found = yaml.safe_load(file)


def filled(text):
    return re.sub(r"\$\{\{ inputs\.(\w+) \}\}", lambda name: inputs[name[1]], str(text))


for job in found.get("jobs", {"gitlab": found.get("rig")}).values():
    for step in job.get("steps", [{"run": line} for line in job.get("script", [])]):
        if "run" in step:
            names = step.get("env", {}).items()
            env = "".join(f"export {name}={shlex.quote(filled(value))}; " for name, value in names)
            print("set -e; " + env + filled(step["run"]).replace("\\\n", " ").replace("\n", "; "))
