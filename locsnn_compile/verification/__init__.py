"""Does the chip do what the network does, and if not, why?"""
