"""The laboratory: videos whose truth is known exactly because we drew them."""
