"""The object families, one per file; importing this package registers them all."""

from pipeline.world.objects.families import bell, block, bottle, bowl, can, cup, hammer, long_block, pad, plate, roller

__all__ = ["bell", "block", "bottle", "bowl", "can", "cup", "hammer", "long_block", "pad", "plate", "roller"]
