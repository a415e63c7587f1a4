/* foreswitch 0.1.0, SPDX-License-Identifier: BSD-3-Clause */
/* The long horizon, exactly: the best command sequence of a switching plant, proven, in microseconds.
 *
 * Included by foreswitch.h where FSW_MAX_MOVES is not 0; fsw_step does everything. Freestanding C99 like the rest: no
 * heap, no recursion, no mutable file-scope data. The constant tables come from the design; the scratch is part of
 * fsw_state.
 */
#ifndef FORESWITCH_HORIZON_H
#define FORESWITCH_HORIZON_H

#ifndef FSW_MAX_STEPS
#define FSW_MAX_STEPS 64 /* last evaluation, the lead of the fastest input included */
#endif
#ifndef FSW_HORIZON_STATES
#define FSW_HORIZON_STATES 16 /* states, and the moves that unequal dead times keep waiting */
#endif
#ifndef FSW_HORIZON_CANDIDATES
#define FSW_HORIZON_CANDIDATES 64 /* at most 255 */
#endif
#ifndef FSW_RECORDS
#define FSW_RECORDS 16 /* at most 127: visited nodes per depth, for the dominance test; 0: none, less memory */
#endif

/* ---- Design ---- */

/* z[k] is the state k periods after the first move's first effect, the dead time removed; inputs that act earlier than
 * the slowest keep their moves waiting in it. Split into the free response (all moves zero, tail and drift included)
 * and what the moves add, x,
 *
 *     x[k+1] = F x[k] + G u[k],   x[0] = 0,   s[k] = S x[k] + e[k],   e = S z_free - s_d      k = 1..steps
 *     J = sum |s|^2 + sum (u[k] - u[k-1])' R (u[k] - u[k-1]) + switch cost + |T (z[steps] - z_T)|^2
 *
 * Bound. Let the moves from k on be real numbers. The best cost from there is V_k(y) = y'P_k y + 2 p_k'y + const in
 * y = (x[k], u[k-1]), and completing the square gives the Riccati recursion. It splits J without remainder:
 *
 *     J = V_0 + sum_k |L_k u[k] - w_k|^2,   w_k = L_k K_k y[k] + t_k,   L'L = B'(P + S'S)B + R,   t = -L^-T (B'p + ..)
 *
 * so V_0 plus the terms of the moves already fixed is a lower bound on every completion, at O(n) per node. P, L and K
 * do not depend on measurement or reference: they are the tables below. p does, through e: fsw_horizon_prepare finds
 * t[k], O(n^2) per step. A zero pivot of L'L is a zero row of L, which bounds nothing and is otherwise harmless.
 *
 * Lift. An input with two levels has (u - a)(u - b) = 0. Subtracting d (u - a)(u - b), d >= 0, changes no cost but
 * raises V_0 wherever the real minimiser lies between a and b. d is chosen at design time so that J stays convex.
 *
 * Price. Far from the reference the real minimiser leaves the levels' hull [a, b] and V_0 says little. For any
 * q >= 0, subtracting q (u - a) and adding it back where u is known leaves a valid bound, as u - a >= 0 at every
 * level; likewise q (b - u). The best q are the multipliers of the minimisation over the hull, once per search.
 *
 * Dominance. With the same moves U still to come, nodes A and B at one depth end with residuals that differ by a
 * known vector of length D = |M_k (y_A - y_B)|, M_k'M_k = sum over k.. of (L K A^i)'(L K A^i). Let g_A, g_B be what
 * their bounds leave below the incumbent. If U takes B below it, B's remaining residual is at most sqrt(g_B), so A's is
 * at most sqrt(g_B) + D, and A is not worse than B if sqrt(g_A) - sqrt(g_B) >= D, that is, if s = g_A - g_B - D^2 >= 0
 * and s^2 >= 4 g_B D^2. Then B can go: at B's depth, a depth-first search has finished A before it comes to B. This
 * keeps the number of nodes per depth nearly constant where the bound alone lets it grow: paths meet in the state. */
typedef enum { FSW_TAIL_ZERO = 0, FSW_TAIL_REST = 1, FSW_TAIL_HOLD = 2 } fsw_tail;

typedef struct fsw_horizon {
    uint16_t steps, moves; /* moves <= steps */
    uint16_t states, inputs, outputs, candidates;
    uint16_t disturbances;
    uint16_t order;    /* derivatives in a reference, the value included */
    uint16_t lead;     /* steps before the first evaluation; the reference has steps - lead instants */
    uint16_t terminal; /* rows of T */
    uint8_t tail;      /* fsw_tail: what the inputs do after the moves */
    uint8_t exclusive; /* there is dwell or a switch cost: only nodes with the same last move are compared */
    uint8_t dominance; /* compare with visited nodes: pays from 1e9 sequences on, or 1e12 of two or three candidates */
    uint32_t patience; /* nodes before prices are tried */
    uint32_t node_budget; /* nodes after which the best sequence so far is taken */

    /* z[1] of the free response, and what each step adds to it */
    const fsw_real *start_row;         /* [states][plant's states] */
    const fsw_real *start_disturbance; /* [states][disturbances] */
    const fsw_real *start_offset;      /* [states] */
    const fsw_real *pending_table;     /* per input [pending][level_count][states]: newest first */
    const fsw_real *drift;             /* [states] */
    const fsw_real *drift_disturbance; /* [states][disturbances] */
    /* s = S z + row_disturbance w + row_offset - reference_row yd; T z_rest */
    const fsw_real *row_disturbance;      /* [outputs][disturbances] */
    const fsw_real *row_offset;           /* [outputs] */
    const fsw_real *reference_row;        /* [outputs][order] */
    const fsw_real *terminal_reference;   /* [terminal][outputs] */
    const fsw_real *terminal_disturbance; /* [terminal][disturbances] */
    const fsw_real *terminal_offset;      /* [terminal] */
    fsw_real far; /* cost above V_0 that rounding alone cannot reach: prices are tried at once */

    const fsw_real *F;             /* [states][states] */
    const fsw_real *G;             /* [states][inputs] */
    const fsw_real *S;             /* [outputs][states] */
    const fsw_real *root_weight;   /* [steps][outputs], 0 outside the window */
    const fsw_real *T;             /* [terminal][states], weighted */
    const fsw_real *move_weight;   /* R [inputs], two-level switch costs included */
    const fsw_real *lift;          /* d [moves][inputs] */
    const fsw_real *lift_centre;   /* d (a + b) / 2 [moves][inputs] */
    const fsw_real *last_value;    /* P after the last move [states + inputs]^2 */
    const fsw_real *hull;          /* a, b [inputs][2] */
    const fsw_real *value;         /* [candidates][inputs] */
    const fsw_real *effect;        /* G u [candidates][states] */
    const fsw_real *gain;          /* L K, state part [moves][inputs][states] */
    const fsw_real *gain_previous; /* L K, previous move [moves][inputs][inputs] */
    const fsw_real *pull;          /* L^-T [moves][inputs][inputs] */
    const fsw_real *place;         /* L u [moves][candidates][inputs] */
    const fsw_real *from_place;    /* L K u, u the previous move [moves][candidates][inputs] */
    const fsw_real *metric;        /* M, state part [moves][states + inputs][states] */
    const fsw_real *from_metric;   /* M u, u the previous move [moves][candidates][states + inputs] */
    const fsw_real *switch_cost;   /* [candidates before][candidates after]; null: none */
    const uint8_t *level;          /* [candidates][inputs] */
    const uint16_t *dwell;         /* [candidates][inputs] periods its level must be kept, >= 1; null: no dwell */
} fsw_horizon;

/* ---- Scratch ---- */

#define FSW_SPAN (FSW_HORIZON_STATES + FSW_MAX_INPUTS) /* x and the previous move */

typedef struct {
    fsw_real target[FSW_MAX_MOVES][FSW_MAX_INPUTS];          /* t */
    fsw_real penalty[FSW_MAX_MOVES][FSW_HORIZON_CANDIDATES]; /* price q of each candidate, as added back */
    fsw_real error[FSW_MAX_STEPS][FSW_MAX_OUTPUTS];          /* e, weighted */
    fsw_real last[FSW_SPAN];                                 /* p after the last move */
    fsw_real end[FSW_HORIZON_STATES];                        /* z_free at the end, */
    fsw_real aim[FSW_HORIZON_STATES];                        /* and T z_rest */
    uint8_t priced;                                          /* penalty is in force */
    union {
        struct { /* depth-first search, per depth */
            fsw_real x[FSW_MAX_MOVES][FSW_HORIZON_STATES];
            fsw_real bound[FSW_MAX_MOVES][FSW_HORIZON_CANDIDATES]; /* open children, best first */
            uint8_t child[FSW_MAX_MOVES][FSW_HORIZON_CANDIDATES];
            uint8_t next[FSW_MAX_MOVES], count[FSW_MAX_MOVES];
            uint8_t path[FSW_MAX_MOVES];
            uint16_t wait[FSW_MAX_MOVES][FSW_MAX_INPUTS];
#if FSW_RECORDS > 0
            uint8_t visits[FSW_MAX_MOVES];
            struct { /* a ring */
                fsw_real bound, at[FSW_SPAN];
                uint16_t wait[FSW_MAX_INPUTS];
                uint8_t from;
            } record[FSW_MAX_MOVES][FSW_RECORDS];
#endif
        } tree;
        struct { /* minimisation over the hull */
            fsw_real row[FSW_MAX_MOVES][FSW_MAX_INPUTS][FSW_SPAN + FSW_MAX_INPUTS];
            fsw_real slope[FSW_MAX_MOVES][FSW_MAX_INPUTS];
            int8_t pinned[FSW_MAX_MOVES][FSW_MAX_INPUTS]; /* -1 at a, +1 at b, 0 free */
        } hull;
    } u;
    uint8_t best[FSW_MAX_MOVES]; /* the answer: candidate indices */
} fsw_horizon_scratch;

typedef struct {
    fsw_real excess; /* cost of scratch.best above the real-valued bound V_0 */
    fsw_real gap;    /* cost of scratch.best above the best proven bound; 0: optimal */
    uint32_t nodes;  /* partial sequences whose bound was computed */
    uint8_t found;   /* 0: no candidate respects the waits given; best is not set */
    uint8_t optimal;
} fsw_horizon_answer;

/* Affine parts of a step, from z [states], the free response at the end of the first step; reference
 * [steps - lead][outputs][order], w [disturbances], rest [inputs]: the level that holds the last reference.
 * O(steps states (states + outputs) + moves inputs (states + inputs)). */
void fsw_horizon_prepare(const fsw_horizon *horizon, fsw_horizon_scratch *scratch, const fsw_real *z,
                         const fsw_real *reference, const fsw_real *w, const fsw_real *rest);

/* Search. present: the candidate in force; wait [inputs]: periods each input must still keep its level; warm [moves]: a
 * sequence to start from (an inadmissible one is only followed as far as it goes), or null; first: the candidate that
 * must come first, or `candidates` for any.
 * The first descent is completed whatever the budget; then the search ends after node_budget nodes. Keeping every
 * level is always admissible, so there is an answer, and more budget never makes it dearer. */
fsw_horizon_answer fsw_horizon_search(const fsw_horizon *horizon, fsw_horizon_scratch *scratch, uint8_t present,
                                      const uint32_t *wait, const uint8_t *warm, uint8_t first, uint32_t node_budget);

/* J of a sequence [moves] of candidates after fsw_horizon_prepare. O(steps states (states + outputs)). */
fsw_real fsw_horizon_cost(const fsw_horizon *horizon, const fsw_horizon_scratch *scratch, uint8_t present,
                          const uint8_t *sequence);

#endif
