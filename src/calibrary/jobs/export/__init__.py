"""Export of a registry for other programs (:meth:`calibrary.Fleet.export`), and the names that they give cameras."""
