component probebench "A touch probe over a tilting rotary table with hidden errors: contact below the controller";
pin in float joint-# [5] "positions of the joints X Y Z A C as commanded to the motors, mm and deg";
pin in s32 motion_type "motion.motion-type: 5 is probing";
pin out bit probe "the ball touches something";
pin out u32 strikes "contacts that began outside a probing move";
pin out u32 stem_strikes "contacts of the stem or of the table";
pin out float deepest "largest depth of the ball in anything, mm";
pin out float struck_depth "largest depth reached in a contact that began outside a probing move, mm";
pin out u32 touches "contacts that began in a probing move";
pin in float speed = 1 "how much faster this machine is than what it stands for";
pin out float moving "time of the machine that it stands for, while a joint moves: none of it waits for the task";
pin out float travelled "sum of the ways of the joints, mm and deg";
pin in bit watch "counting starts here: the axes are homed";
option extra_setup;
option singleton yes;
modparam dummy machine "file of numbers that describe the machine, see machine.py";
function _ fp;
license "GPL";
author "trunnion";
;;
#include <math.h>
#include <stdio.h>
#include <stdlib.h>

static char *machine = "";
RTAPI_MP_STRING(machine, "file of numbers that describe the machine");

#define MOST_BOXES 16
typedef struct { double r[9], t[3]; } pose_t;

/* In the order of the file. */
static double origin[3];      /* machine coordinates of the origin of the machine frame */
static double tool_mm;        /* length of the probe to the centre of its ball */
static double ball_mm, stem_mm, stem_length_mm;
static pose_t place_a, place_c, place_s;
static double table_radius, table_thickness, table_z;
static double noise_mm;
static int boxes;
static double box[MOST_BOXES][7];   /* middle, half sides and radius of the edges, artefact frame */
static unsigned long long state_of_noise;

static double uniform(void) {
    state_of_noise = state_of_noise * 6364136223846793005ULL + 1442695040888963407ULL;
    return ((state_of_noise >> 11) + 0.5) / 9007199254740992.0;
}
static double normal(void) { return sqrt(-2 * log(uniform())) * cos(6.283185307179586 * uniform()); }

/* p = r^T (q - t) */
static void undo(const pose_t *pose, const double q[3], double p[3]) {
    double d[3] = {q[0] - pose->t[0], q[1] - pose->t[1], q[2] - pose->t[2]};
    for (int i = 0; i < 3; i++) p[i] = pose->r[i] * d[0] + pose->r[3 + i] * d[1] + pose->r[6 + i] * d[2];
}
static void turn_x(double angle, double p[3]) {
    double c = cos(angle), s = sin(angle), y = p[1], z = p[2];
    p[1] = c * y - s * z; p[2] = s * y + c * z;
}
static void turn_z(double angle, double p[3]) {
    double c = cos(angle), s = sin(angle), x = p[0], y = p[1];
    p[0] = c * x - s * y; p[1] = s * x + c * y;
}
/* Machine frame to table frame (before the artefact's place), then to the artefact's. */
static void to_table(double a, double c, const double q[3], double table[3], double artefact[3]) {
    double p[3], w[3];
    undo(&place_a, q, p); turn_x(-a, p);
    undo(&place_c, p, w); turn_z(-c, w);
    for (int i = 0; i < 3; i++) table[i] = w[i];
    undo(&place_s, w, artefact);
}
static double to_boxes(const double p[3]) {
    double least = 1e9;
    for (int b = 0; b < boxes; b++) {
        double out = 0, in = -1e9;
        for (int i = 0; i < 3; i++) {
            double d = fabs(p[i] - box[b][i]) - box[b][3 + i];
            if (d > 0) out += d * d;
            if (d > in) in = d;
        }
        double distance = (out > 0 ? sqrt(out) : in) - box[b][6];
        if (distance < least) least = distance;
    }
    return least;
}
static double to_disc(const double p[3]) {
    double radial = hypot(p[0], p[1]) - table_radius;
    double axial = fabs(p[2] - table_z + 0.5 * table_thickness) - 0.5 * table_thickness;
    if (radial > 0 && axial > 0) return hypot(radial, axial);
    return radial > axial ? radial : axial;
}

EXTRA_SETUP() {
    (void)__comp_inst; (void)prefix; (void)extra_arg;
    FILE *file = fopen(machine, "r");
    double seed = 1, count = 0;
    if (!file) { rtapi_print_msg(RTAPI_MSG_ERR, "probebench: no file %s\n", machine); return -1; }
    double *plain[] = {origin, origin + 1, origin + 2, &tool_mm, &ball_mm, &stem_mm, &stem_length_mm,
        &table_radius, &table_thickness, &table_z, &noise_mm, &seed};
    int bad = 0;
    for (unsigned i = 0; i < sizeof plain / sizeof *plain; i++) bad |= fscanf(file, "%lf", plain[i]) != 1;
    pose_t *poses[] = {&place_a, &place_c, &place_s};
    for (int k = 0; k < 3; k++) {
        for (int i = 0; i < 9; i++) bad |= fscanf(file, "%lf", &poses[k]->r[i]) != 1;
        for (int i = 0; i < 3; i++) bad |= fscanf(file, "%lf", &poses[k]->t[i]) != 1;
    }
    bad |= fscanf(file, "%lf", &count) != 1;
    boxes = (int)count;
    if (boxes > MOST_BOXES) bad = 1;
    for (int b = 0; b < boxes && !bad; b++)
        for (int i = 0; i < 7; i++) bad |= fscanf(file, "%lf", &box[b][i]) != 1;
    fclose(file);
    state_of_noise = (unsigned long long)seed;
    for (int i = 0; i < 8; i++) uniform();
    if (bad) rtapi_print_msg(RTAPI_MSG_ERR, "probebench: %s is not as expected\n", machine);
    return bad ? -1 : 0;
}

FUNCTION(_) {
    static double noise = 0;
    static int began_outside = 0, stem_was = 0;
    static double last[5];
    int moves = 0;
    for (int i = 0; i < 5; i++) {
        if (fabs(joint(i) - last[i]) < 100) travelled += fabs(joint(i) - last[i]);
        moves |= joint(i) != last[i];
        last[i] = joint(i);
    }
    if (moves) moving += 1e-9 * period * speed;
    if (!watch) return;
    double radians = 0.017453292519943295;
    double a = radians * joint(3), c = radians * joint(4), table[3], artefact[3], depth;
    double q[3] = {joint(0) - origin[0], joint(1) - origin[1], joint(2) - origin[2] - tool_mm};
    to_table(a, c, q, table, artefact);
    double on_boxes = ball_mm - to_boxes(artefact) + noise, on_table = ball_mm - to_disc(table);
    depth = on_boxes > on_table ? on_boxes : on_table;
    int hit = depth > 0, stem_hit = on_table > 0;
    for (double up = 0; up < stem_length_mm; up += 1.0) {
        double s[3] = {q[0], q[1], q[2] + up};
        to_table(a, c, s, table, artefact);
        if (to_boxes(artefact) < stem_mm || to_disc(table) < stem_mm) { stem_hit = 1; break; }
    }
    if (depth > deepest) deepest = depth;
    if ((hit || stem_hit) && !probe) {
        began_outside = motion_type != 5;
        if (began_outside) strikes++; else touches++;
    }
    if (stem_hit && !stem_was) stem_strikes++;
    stem_was = stem_hit;
    if (hit && began_outside && depth > struck_depth) struck_depth = depth;
    if (!hit && !stem_hit && probe && noise_mm > 0) noise = noise_mm * normal();
    probe = hit || stem_hit;
}
