"""Robot descriptions: found, read once and checked."""
