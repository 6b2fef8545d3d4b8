"""The contract of a policy, and policies of this process."""
