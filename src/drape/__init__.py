"""Learn the constitutive law of a fabric from the motion of one piece of cloth, and animate any garment with it."""

__version__ = "0.1.0"
