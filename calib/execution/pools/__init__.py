"""Pools whose evaluations run in child processes: of this machine, or of others."""
