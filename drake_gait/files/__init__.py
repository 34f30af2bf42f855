"""Files: read in any encoding, written whole or not at all."""
