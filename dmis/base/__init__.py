"""Tools without rendering in them: vectors, selections, patches, colours, argument checks, files and memory."""
