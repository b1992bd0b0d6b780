"""The animations of a file that has several (the clips of a GLB, the takes of an FBX), of which one is played."""

from __future__ import annotations

from drape.errors import DrapeError


def keyed(bpy) -> list:
    """Objects and shape keys that have an animation."""
    keys = [mesh.shape_keys for mesh in bpy.data.meshes if mesh.shape_keys]
    return [owner for owner in [*bpy.data.objects, *keys] if owner.animation_data]


def chosen_clip(bpy, kind: str, clip: str | None) -> list[str]:
    """Let everything play the clip of this name, or the only one; what there is to say about it.

    Raises:
        DrapeError: several clips and no name, or a name that none has.
    """
    by_owner = [(owner, _clips(bpy, owner, kind)) for owner in keyed(bpy)]
    names = list(dict.fromkeys(name for _, clips in by_owner for name in clips))
    if clip is None and len(names) > 1:
        raise DrapeError(f"found {len(names)} clips ({_told(names)}); name one of them: scene.body_clip={names[0]!r}")
    if clip is not None and clip not in names:
        raise DrapeError(f"body_clip: found {clip!r}; expected one of the file's: {_told(names) or 'it has none'}")
    if not names:
        return []
    chosen = clip or names[0]
    for owner, clips in by_owner:
        owner.animation_data.action = None
        if chosen in clips:
            action, slot = clips[chosen]
            owner.animation_data.action = action
            owner.animation_data.action_slot = slot
    return [f"clip {chosen!r}"] if len(names) > 1 else []


def _clips(bpy, owner, kind: str) -> dict:
    """Action and slot of each clip in which this owner moves."""
    if kind != ".fbx":
        strips = [(track.name, strip) for track in owner.animation_data.nla_tracks for strip in track.strips]
        found = {name: (strip.action, strip.action_slot) for name, strip in strips}
        action = owner.animation_data.action
        return found or ({action.name: (action, owner.animation_data.action_slot)} if action else {})
    slots = [(action, slot) for action in bpy.data.actions for slot in action.slots]
    mine = [(action, slot) for action, slot in slots if slot.name_display == owner.name]
    return {action.name.rpartition("|")[2] if action.name.count("|") == 1 else action.name: (action, slot)
            for action, slot in mine}  # fmt: skip


def _told(names: list[str]) -> str:
    return ", ".join(map(repr, names))
