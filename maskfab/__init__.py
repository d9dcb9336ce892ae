"""maskfab: photomask plates for under-panel cameras, and the pictures they will make."""

__version__ = "0.1.0"
