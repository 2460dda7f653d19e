"""Reading of images from disks, archives and servers: listed once, read independently, merged in any order."""
