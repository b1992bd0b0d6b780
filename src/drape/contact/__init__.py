"""Proximity: cloth and bodies as surfaces, nearest faces and points, what is inside or crosses."""
