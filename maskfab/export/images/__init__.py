"""Pictures and fields as files: bitmaps of masks, emitted light as OpenEXR and PNG, PSFs as OpenEXR."""
