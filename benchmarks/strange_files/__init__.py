"""Strange files of robots, objects, textures and light: read as they are meant, or refused."""
