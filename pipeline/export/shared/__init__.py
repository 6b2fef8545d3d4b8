"""What several formats share: selection, images, videos, statistics, hashes and provenance."""
