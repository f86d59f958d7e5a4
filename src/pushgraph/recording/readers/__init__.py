"""Readers: one file a format, thin over a library that knows it, each from a file to Sightings."""
