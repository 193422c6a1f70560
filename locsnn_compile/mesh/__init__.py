"""Networks compiled for chips with cores at places of a mesh, such as Loihi, and for the open core."""
