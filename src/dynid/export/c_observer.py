"""Momentum and its observer in the generated C header; marks as in `c_template`."""

OBSERVER = """
/* Generalised momentum p = M dq, and the derivative of the kinetic energy by q.
   Without contact dp/dt = torque - friction - gravity + slope. */
static inline void @_momentum(const double q[$_JOINTS], const double dq[$_JOINTS],
                              double p[$_JOINTS], double slope[$_JOINTS])
{
    static const double none[3] = {0.0, 0.0, 0.0};
    double rotation[$_JOINTS][9], place[$_JOINTS][3], turn[$_JOINTS][3], drift[$_JOINTS][3];
    double linear[$_JOINTS][3], angular[$_JOINTS][3];
    double w[3] = {0.0, 0.0, 0.0}, v[3] = {0.0, 0.0, 0.0}, t[3], u[3];
    double l[3] = {0.0, 0.0, 0.0}, h[3] = {0.0, 0.0, 0.0};
    int i, k;
    for (i = 0; i < $_JOINTS; ++i) {
        @_frame(i, q[i], rotation[i], place[i]);
        @_cross(w, place[i], t);
        for (k = 0; k < 3; ++k) t[k] += v[k];
        @_into(rotation[i], t, v);
        for (k = 0; k < 3; ++k) t[k] = w[k];
        @_into(rotation[i], t, w);
        for (k = 0; k < 3; ++k) {
            if (@_prismatic[i]) v[k] += dq[i] * @_axis[i][k];
            else w[k] += dq[i] * @_axis[i][k];
            turn[i][k] = w[k];
            drift[i][k] = v[k];
        }
        @_wrench(@_inertials[i], none, w, v, linear[i], angular[i]);
    }
    for (i = $_JOINTS - 1; i >= 0; --i) {
        const double *axis = @_axis[i];
        for (k = 0; k < 3; ++k) {
            l[k] += linear[i][k];
            h[k] += angular[i][k];
        }
        @_cross(turn[i], axis, t);
        @_cross(drift[i], axis, u);
        p[i] = slope[i] = 0.0;
        for (k = 0; k < 3; ++k) {
            p[i] += axis[k] * (@_prismatic[i] ? l[k] : h[k]);
            slope[i] += @_prismatic[i] ? l[k] * t[k] : h[k] * t[k] + l[k] * u[k];
        }
        for (k = 0; k < 3; ++k) t[k] = l[k];
        @_out(rotation[i], t, l);
        for (k = 0; k < 3; ++k) t[k] = h[k];
        @_out(rotation[i], t, h);
        @_cross(place[i], l, t);
        for (k = 0; k < 3; ++k) h[k] += t[k];
    }
    @_add_motors(dq, p);
}

/* Momentum observer: external joint torques, low-passed. Begin with all bytes zero, then call
   step once a cycle with what was measured; the residual [N.m, N] stands in the struct. */
typedef struct {
    double start[$_JOINTS], integral[$_JOINTS], push[$_JOINTS], residual[$_JOINTS];
    int running;
} @_observer;

/* bandwidth [1/s]: larger is faster and noisier; dt [s] since the step before. */
static inline void @_observer_step(@_observer *o, double bandwidth, double dt,
                                   const double q[$_JOINTS], const double dq[$_JOINTS],
                                   const double torque[$_JOINTS])
{
    double own[$_JOINTS], slope[$_JOINTS], weight[$_JOINTS], rubbing[$_JOINTS];
    int i;
    @_momentum(q, dq, own, slope);
    @_gravity(q, weight);
    <friction>
    for (i = 0; i < $_JOINTS; ++i) {
        const double push = torque[i] - weight[i] - rubbing[i] + slope[i];
        if (o->running) {
            o->integral[i] += dt * (push + o->push[i]) / 2.0;
            o->residual[i] = bandwidth * (own[i] - o->start[i] - o->integral[i])
                             / (1.0 + bandwidth * dt);
            o->integral[i] += dt * o->residual[i];
        } else {
            o->start[i] = own[i];
            o->integral[i] = o->residual[i] = 0.0;
        }
        o->push[i] = push;
    }
    o->running = 1;
}
"""
