"""Scenes, tracks and beliefs in a browser, drawn with viser; what makes pictures and animations is in `viewer`."""
