"""Audit of a registry: the cameras that flew compared with its entries (:meth:`calibrary.Fleet.audit`)."""
