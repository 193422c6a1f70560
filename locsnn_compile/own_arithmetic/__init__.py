"""What families of chips with an arithmetic of their own share: one setting, the check, its report.

Such a chip plays a program whole, recording by recording; there are no levels between network and
program that every family has, and no table of energies. What only one family has lies in its room.
"""
