"""Everything of a document that an edit may change."""


def snapshot(document):
    """Everything an edit may change, as bytes and values."""
    arrays = [document.state.flags, document.colors.indices, document.colors.matrices, document.colors.alphas]
    arrays += [document.transforms.indices, document.transforms.values]
    arrays += [document.scene.instance_ids, *document.scene.gaussians.arrays().values()]
    arrays += [array for track in document.scene.actors for array in (track.world_from_box, track.dimensions)]
    return [array.tobytes() for array in arrays], list(document.scene.table), document.first_free_id
