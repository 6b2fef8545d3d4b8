"""The sanity ladder: small networks on states, trained in minutes, that show what memory buys on
moving targets."""
