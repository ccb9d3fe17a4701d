"""The functions of the generated C header, the same for every robot.

`@` stands for the robot's prefix in lower case, `$` for the one in upper case. Friction stands at
`<friction>`; `<state>` is what it is called with, `<still>` the same where no acceleration is
known, which `<note>` explains.
"""

BODY = """
static inline void @_cross(const double a[3], const double b[3], double out[3])
{
    out[0] = a[1] * b[2] - a[2] * b[1];
    out[1] = a[2] * b[0] - a[0] * b[2];
    out[2] = a[0] * b[1] - a[1] * b[0];
}

/* v = R' v */
static inline void @_into(const double r[9], double v[3])
{
    const double x = v[0], y = v[1], z = v[2];
    v[0] = r[0] * x + r[3] * y + r[6] * z;
    v[1] = r[1] * x + r[4] * y + r[7] * z;
    v[2] = r[2] * x + r[5] * y + r[8] * z;
}

/* v = R v */
static inline void @_out(const double r[9], double v[3])
{
    const double x = v[0], y = v[1], z = v[2];
    v[0] = r[0] * x + r[1] * y + r[2] * z;
    v[1] = r[3] * x + r[4] * y + r[5] * z;
    v[2] = r[6] * x + r[7] * y + r[8] * z;
}

/* Rotation and place of joint frame i in the one before. */
static inline void @_frame(int i, double q, double rotation[9], double place[3])
{
    const double s = @_prismatic[i] ? 0.0 : sin(q), c = @_prismatic[i] ? 0.0 : cos(q);
    int k;
    for (k = 0; k < 9; ++k)
        rotation[k] = @_fixed[i][k] + @_sine[i][k] * s + @_cosine[i][k] * c;
    for (k = 0; k < 3; ++k) place[k] = @_origin[i][k] + @_slide[i][k] * q;
}

/* Rate of change of a body's momentum about its frame: force and moment. */
static inline void @_wrench(const double b[10], const double w[3], const double dw[3],
                            const double a[3], double force[3], double moment[3])
{
    const double *h = b + 1;
    double u[3], jw[3], jdw[3];
    int k;
    @_cross(w, h, u);
    @_cross(w, u, force);
    @_cross(dw, h, u);
    for (k = 0; k < 3; ++k) force[k] += b[0] * a[k] + u[k];
    jw[0] = b[4] * w[0] + b[9] * w[1] + b[8] * w[2];
    jw[1] = b[9] * w[0] + b[5] * w[1] + b[7] * w[2];
    jw[2] = b[8] * w[0] + b[7] * w[1] + b[6] * w[2];
    jdw[0] = b[4] * dw[0] + b[9] * dw[1] + b[8] * dw[2];
    jdw[1] = b[9] * dw[0] + b[5] * dw[1] + b[7] * dw[2];
    jdw[2] = b[8] * dw[0] + b[7] * dw[1] + b[6] * dw[2];
    @_cross(w, jw, moment);
    @_cross(h, a, u);
    for (k = 0; k < 3; ++k) moment[k] += jdw[k] + u[k];
}

/* Recursive Newton-Euler in the joint frames, for bodies of the given parameters. */
static inline void @_rigid_body(const double bodies[$_JOINTS][10], const double q[$_JOINTS],
                                const double dq[$_JOINTS], const double ddq[$_JOINTS],
                                const double gravity[3], double torque[$_JOINTS])
{
    double rotation[$_JOINTS][9], place[$_JOINTS][3];
    double force[$_JOINTS][3], moment[$_JOINTS][3];
    double w[3] = {0.0, 0.0, 0.0}, dw[3] = {0.0, 0.0, 0.0}, a[3], t[3], u[3];
    double f[3] = {0.0, 0.0, 0.0}, m[3] = {0.0, 0.0, 0.0};
    int i, k;
    for (k = 0; k < 3; ++k) a[k] = -gravity[k];
    for (i = 0; i < $_JOINTS; ++i) {
        const double *axis = @_axis[i];
        @_frame(i, q[i], rotation[i], place[i]);
        @_cross(w, place[i], t);
        @_cross(w, t, u);
        @_cross(dw, place[i], t);
        for (k = 0; k < 3; ++k) a[k] += t[k] + u[k];
        @_into(rotation[i], a);
        @_into(rotation[i], w);
        @_into(rotation[i], dw);
        @_cross(w, axis, t);
        if (@_prismatic[i]) {
            for (k = 0; k < 3; ++k) a[k] += 2.0 * dq[i] * t[k] + ddq[i] * axis[k];
        } else {
            for (k = 0; k < 3; ++k) {
                dw[k] += ddq[i] * axis[k] + dq[i] * t[k];
                w[k] += dq[i] * axis[k];
            }
        }
        @_wrench(bodies[i], w, dw, a, force[i], moment[i]);
    }
    for (i = $_JOINTS - 1; i >= 0; --i) {
        const double *axis = @_axis[i];
        for (k = 0; k < 3; ++k) {
            f[k] += force[i][k];
            m[k] += moment[i][k];
        }
        torque[i] = @_prismatic[i] ? axis[0] * f[0] + axis[1] * f[1] + axis[2] * f[2]
                                   : axis[0] * m[0] + axis[1] * m[1] + axis[2] * m[2];
        @_out(rotation[i], f);
        @_out(rotation[i], m);
        @_cross(place[i], f, t);
        for (k = 0; k < 3; ++k) m[k] += t[k];
    }
}

/* Speed of a coupled motor. */
static inline double @_motor(int k, const double dq[$_JOINTS])
{
    double speed = 0.0;
    int i;
    for (i = 0; i < $_JOINTS; ++i) speed += @_shares[k][i] * dq[i];
    return speed;
}

/* Adds the torque of a coupled motor to those of the joints. */
static inline void @_add_motor(int k, double push, double *torque)
{
    int i;
    for (i = 0; i < $_JOINTS; ++i) torque[i] += @_shares[k][i] * push;
}

/* Adds the torques that turn the motors. */
static inline void @_add_motors(const double ddq[$_JOINTS], double *torque)
{
    int i, k;
    for (i = 0; i < $_JOINTS; ++i) torque[i] += @_im[i] * ddq[i];
    for (k = 0; k < $_MOTORS; ++k) @_add_motor(k, @_imm[k] * @_motor(k, ddq), torque);
}

/* Adds what counterbalances leave for the motors. */
static inline void @_add_known(const double *q, double *torque)
{
    int k;
    for (k = 0; k < $_COUNTERBALANCES; ++k) {
        const double outer = @_counterbalances[k].outer, inner = @_counterbalances[k].inner;
        const double area = @_counterbalances[k].piston_area;
        const double angle = q[@_counterbalances[k].joint] + @_counterbalances[k].offset;
        const double length =
            sqrt(outer * outer + inner * inner - 2.0 * outer * inner * cos(angle));
        const double arm = outer * inner * sin(angle) / length;
        const double volume =
            @_counterbalances[k].gas_volume - (length - @_counterbalances[k].rest_length) * area;
        torque[@_counterbalances[k].joint] += arm * @_counterbalances[k].gas_work * area / volume;
    }
}

/* Coulomb friction as a share of its largest. */
static inline double @_step(double speed, double width)
{
    if (width > 0.0) return tanh(speed / width);
    return (double)((speed > 0.0) - (speed < 0.0));
}

<friction>
/* Torques [N.m, N] that move the arm: M ddq + coriolis + gravity + friction. */
static inline void @_inverse_dynamics(const double q[$_JOINTS], const double dq[$_JOINTS],
                                      const double ddq[$_JOINTS], double torque[$_JOINTS])
{
    double rubbing[$_JOINTS];
    int i;
    @_rigid_body(@_inertials, q, dq, ddq, @_gravity_vector, torque);
    @_add_motors(ddq, torque);
    @_add_known(q, torque);
    @_friction(<state>, rubbing);
    for (i = 0; i < $_JOINTS; ++i) torque[i] += rubbing[i];
}

/* Mass matrix with the motor inertias [kg.m^2, kg]. */
static inline void @_mass_matrix(const double q[$_JOINTS], double mass[$_JOINTS][$_JOINTS])
{
    static const double none[$_JOINTS] = {0.0};
    static const double weightless[3] = {0.0, 0.0, 0.0};
    double unit[$_JOINTS], column[$_JOINTS];
    int i, j;
    for (j = 0; j < $_JOINTS; ++j) {
        for (i = 0; i < $_JOINTS; ++i) unit[i] = i == j ? 1.0 : 0.0;
        @_rigid_body(@_inertials, q, none, unit, weightless, column);
        @_add_motors(unit, column);
        for (i = 0; i < $_JOINTS; ++i) mass[i][j] = column[i];
    }
}

/* Coriolis and centrifugal torques C(q, dq) dq. */
static inline void @_coriolis(const double q[$_JOINTS], const double dq[$_JOINTS],
                              double torque[$_JOINTS])
{
    static const double none[$_JOINTS] = {0.0};
    static const double weightless[3] = {0.0, 0.0, 0.0};
    @_rigid_body(@_inertials, q, dq, none, weightless, torque);
}

/* Torques that hold the arm still without friction, counterbalances included. */
static inline void @_gravity(const double q[$_JOINTS], double torque[$_JOINTS])
{
    static const double none[$_JOINTS] = {0.0};
    @_rigid_body(@_inertials, q, none, none, @_gravity_vector, torque);
    @_add_known(q, torque);
}

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
        for (k = 0; k < 3; ++k) v[k] += t[k];
        @_into(rotation[i], v);
        @_into(rotation[i], w);
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
        @_out(rotation[i], l);
        @_out(rotation[i], h);
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
<note>    @_momentum(q, dq, own, slope);
    @_gravity(q, weight);
    @_friction(<still>, rubbing);
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

SPEED = """\
/* Friction torques [N.m, N] at speeds dq. */
static inline void @_speed_friction(const double dq[$_JOINTS], double torque[$_JOINTS])
{
    int i, k;
    for (i = 0; i < $_JOINTS; ++i) {
        const double v = dq[i], step = @_step(v, @_width[i]), share = v / @_stribeck_velocity;
        torque[i] = @_fc[i] * step + @_fv[i] * v + @_fo[i]
                    + @_fca[i] * fabs(step) + @_fva[i] * fabs(v)
                    + @_fs[i] * exp(-share * share) * step + @_fr[i] * cbrt(v);
    }
    for (k = 0; k < $_MOTORS; ++k) {
        const double v = @_motor(k, dq), step = @_step(v, @_motor_width[k]);
        @_add_motor(k, @_fcm[k] * step + @_fvm[k] * v, torque);
    }
}
"""

LOAD = """\
/* Adds the friction that grows with the load of a gear. */
static inline void @_add_load_friction(const double q[$_JOINTS], const double dq[$_JOINTS],
                                       const double ddq[$_JOINTS], double *torque)
{
    double load[$_JOINTS];
    int i;
    @_rigid_body(@_load, q, dq, ddq, @_gravity_vector, load);
    @_add_known(q, load);
    for (i = 0; i < $_JOINTS; ++i)
        torque[i] += @_fl[i] * fabs(load[i]) * @_step(dq[i], @_width[i]);
}
"""

RIPPLE = """\
/* Adds the torque ripple of gears: waves in a position, their size by the speed's share of the
   fastest that was identified, beyond which they stay as they are. */
static inline void @_add_ripple(const double *q, const double *dq, double *torque)
{
    int w, k;
    for (w = 0; w < <waves>; ++w) {
        const int gear = @_waves[w].gear;
        const double share = fmax(-1.0, fmin(1.0, dq[gear] / @_waves[w].speed));
        double cosine = 0.0, sine = 0.0;
        for (k = <powers> - 1; k >= 0; --k) {
            cosine = cosine * share + @_waves[w].cosine[k];
            sine = sine * share + @_waves[w].sine[k];
        }
        torque[@_waves[w].joint] += cosine * cos(@_waves[w].number * q[gear])
                                    + sine * sin(@_waves[w].number * q[gear]);
    }
}
"""

SHAPED = """\
/* Friction torques [N.m, N], all of them:
<words>
   Where no acceleration is known, give zeros for ddq. */
static inline void @_friction(const double q[$_JOINTS], const double dq[$_JOINTS],
                              const double ddq[$_JOINTS], double torque[$_JOINTS])
{
    @_speed_friction(dq, torque);
<calls>
    (void)ddq;
}
"""
