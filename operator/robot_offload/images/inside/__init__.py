"""Files that are written into images as they are. They run there, with the image's own Python."""
