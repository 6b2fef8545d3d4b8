"""The network: a backbone that reads images and text, queries, and the heads on them."""
