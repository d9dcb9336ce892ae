"""Written files against their plate, and mask files that maskfab did not write against a job."""
