"""Energies as densities per rest length, a file each, in local invariants of the centerline.

With t = r'(u), k = r''(u): c = t.t, d = t.k, h = k.k. A term gives its energy, its gradient, and
for the discrete gradient between configurations 0 and 1 its divided differences (`mean_gradient`)
and their derivatives by configuration 1 (`mean_hessian`), all without cancellation. Terms know
nothing of meshes, samples or methods.
"""
