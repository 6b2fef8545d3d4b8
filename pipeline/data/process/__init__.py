"""What of this machine a process may use, and code of others within limits."""
