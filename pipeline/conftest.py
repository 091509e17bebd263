"""The examples in docstrings are tests; each runs in a folder of its own."""

import pytest

# Adapters of other solvers run in processes of their own, where their packages are.
collect_ignore_glob = ["archbench/adapters/*_adapter.py"]


@pytest.fixture(autouse=True)
def _empty_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
