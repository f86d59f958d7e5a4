"""Pictures and animations of tracks."""
