"""Tooling of the benches: rows, faults, fuzz tests, drawings and the page of all results."""
