"""Contact of cloth with itself and with bodies: what meets, presses, crosses, is inside, and how it gets out."""
