"""What of this machine a process may use, and code and files of others within limits."""
