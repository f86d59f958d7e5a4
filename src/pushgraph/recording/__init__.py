"""Recordings of pushes as people have them, read into tracks.

    file -> readers -> Sightings -> convention -> assembly -> plausibility -> Track and Findings

Nothing is imported here: readers of binary files run in a process of their own, which should start quickly.
"""
