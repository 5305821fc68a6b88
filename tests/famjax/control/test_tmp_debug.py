import numpy as np, jax, jax.numpy as jnp, famjax
from famjax.control import *
import famjax.control.crossing as cr
def test_dbg(festo):
    softer=famjax.Muscle(festo.geometry, famjax.PolynomialMaterial([4e6, -12e6, 16e6]), 30e3)
    pair=Antagonist(festo,softer,(Pulley(0.02,0.275),Pulley(-0.018,0.272)),(0.,6e5),(-.9,.9))
    x=jnp.linspace(0.02,0.98,105); A=jnp.full(105,-.2)-1.11e-15
    def one(a,x):
        c=pair.at(a).curve(jnp.array(-3.0)); t=c.stiffness(x)
        s=c.share_of(t)
        even=jnp.linspace(0,1,33)
        v=jax.vmap(c.stiffness)(even)
        return c.extremes(), s.at, s.found, t, v, s.lowest, s.highest
    ex,at,found,t,v,lo,hi=jax.jit(jax.vmap(one))(A,x)
    bad=np.abs(at-x)>1e-9
    print(bad.sum(), np.array(at)[bad][:6], np.array(x)[bad][:6], np.array(ex)[bad][:6])
    for k in np.flatnonzero(bad)[:3]: print(np.array(t[k]-v[k]), lo[k],hi[k], found[k])
    print(np.abs(ex-jnp.array([0,1])).max())
    assert 0
