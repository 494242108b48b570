"""Prints the shell commands of a CI file, one step a line, what is in its braces filled in.

usage: steps.py FILE [NAME=VALUE ..]

NAME is an input of a GitHub workflow, or an environment variable of the file in capitals.
"""

import re
import shlex
import sys

import yaml

path, *values = sys.argv[1:]
given = dict(value.split("=", 1) for value in values)
with open(path, encoding="utf-8") as file:
    found = yaml.safe_load(file)


def filled(text):
    return re.sub(r"\$\{\{ inputs\.(\w+) \}\}", lambda name: given[name[1]], str(text))


def steps_of(found):
    """The steps of a file for GitHub, Woodpecker or GitLab: shell text, and its environment."""
    jobs = found.get("jobs") or {}
    for job in jobs.values():
        for step in job["steps"]:
            if "run" in step:
                yield step["run"], {**found.get("env", {}), **step.get("env", {})}
    for step in found.get("steps", []):
        for line in step["commands"]:
            yield line, step.get("environment", {})
    for job in found.values():
        if isinstance(job, dict) and "script" in job:
            for line in job["script"]:
                yield line, job.get("variables", {})


for text, env in steps_of(found):
    env = {name: given.get(name, filled(value)) for name, value in env.items()}
    exports = "".join(f"export {name}={shlex.quote(value)}; " for name, value in env.items())
    print("set -e; " + exports + filled(text).replace("\\\n", " ").replace("\n", "; "))
