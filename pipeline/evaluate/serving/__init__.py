"""Policies over a network: one hardened server and client, and clients of the servers that others
run."""
