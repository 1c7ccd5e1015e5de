"""Energy densities per rest length, as functions of invariants of the centreline: those that the
engine adds up in one loop (`engine.elastic`), or that several of its terms use.

With t = r'(u), k = r''(u): c = t.t, d = t.k, h = k.k. A term has its energy, its gradient, the
divided differences of the discrete gradient between configurations 0 and 1 (`discrete_gradient`)
and their derivatives with respect to configuration 1 (`discrete_jacobian`), all without
cancellation. Terms do not depend on meshes, samples or methods.
"""
