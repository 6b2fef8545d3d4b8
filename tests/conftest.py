"""Shared by all tests. Its being here makes pytest put the repository root first on the path, so that `tests.synthetic` is ours."""
