"""Workflows of the forge: least permissions, actions by full commit, systems and Pythons."""

import re
import tomllib
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[2]
FORGE = ROOT / ".github"
WORKFLOWS = {path.stem: path for path in (FORGE / "workflows").iterdir()}
WRITES = {"release": {"publish": {"id-token", "attestations", "artifact-metadata"}}}


def read(path):
    return yaml.load(path.read_text("utf-8"), yaml.BaseLoader)  # where `on` is a word


@pytest.mark.parametrize("name", WORKFLOWS)
class TestWorkflow:
    def test_each_job_has_the_least_permissions(self, name):
        workflow = read(WORKFLOWS[name])
        assert workflow["permissions"] == {}
        for job, keys in workflow["jobs"].items():
            writes = {
                key for key, kind in keys["permissions"].items() if kind == "write"
            }
            assert writes == WRITES.get(name, {}).get(job, set())
            assert keys["permissions"].get("contents", "read") == "read"
            assert int(keys["timeout-minutes"]) <= 90
            for step in keys["steps"]:
                if step.get("uses", "").startswith("actions/checkout@"):
                    assert step["with"]["persist-credentials"] == "false"

    def test_actions_are_named_by_commit_with_the_version_beside(self, name):
        lines = re.findall(r"uses: (.*)", WORKFLOWS[name].read_text("utf-8"))
        assert len(lines) > 2
        for line in lines:
            assert re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40}  # v\d+\.\d+\.\d+", line)


def test_systems_and_pythons():
    matrix = read(WORKFLOWS["ci"])["jobs"]["fast"]["strategy"]["matrix"]
    systems = {system.partition("-")[0] for system in matrix["system"]}
    assert systems == {"ubuntu", "windows", "macos"}
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    pythons = re.findall(r":: (3\.\d+)", str(project["classifiers"]))
    assert matrix["python"] == [pythons[0], "3.14"]  # no classifier until it has passed
    assert project["requires-python"] == f">={pythons[0]}"


def test_a_release_is_made_by_hand():
    assert list(read(WORKFLOWS["release"])["on"]) == ["workflow_dispatch"]
    (updates,) = read(FORGE / "dependabot.yml")["updates"]
    assert updates["package-ecosystem"] == "github-actions"
