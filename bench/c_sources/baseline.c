/* The article's algorithms in C99: each loop once with a pointer to the right-hand side, and once for each problem with
   the right-hand side inlined. */
#include "problems.h"
#include "ldu.h"

typedef double (*scalar_rhs)(double t, double u, double v, const double *p);
typedef void (*vector_rhs)(double t, const double *u, const double *v, const double *p, double *a);

/* The caller gets the pointer at run time, so the compiler cannot inline the function behind it. */
scalar_rhs pointer_single_dof(void) { return single_dof; }
scalar_rhs pointer_hardening_spring(void) { return hardening_spring; }
scalar_rhs pointer_softening_spring(void) { return softening_spring; }
vector_rhs pointer_spring_pendulum(void) { return spring_pendulum; }

#define NAME(method) method##_scalar
#define RHS scalar_rhs f,
#define F(t, u, v) f(t, u, v, p)
#include "scalar_loops.h"

#define NAME(method) method##_single_dof
#define RHS
#define F(t, u, v) single_dof(t, u, v, p)
#include "scalar_loops.h"

#define NAME(method) method##_hardening_spring
#define RHS
#define F(t, u, v) hardening_spring(t, u, v, p)
#include "scalar_loops.h"

#define NAME(method) method##_softening_spring
#define RHS
#define F(t, u, v) softening_spring(t, u, v, p)
#include "scalar_loops.h"

/* Both ways know when compiling that N is 2, since the article's program was written for its problems. */
#define N 2
#define NAME(method) method##_vector
#define RHS vector_rhs f,
#define F(t, u, v, a) f(t, u, v, p, a)
#include "vector_loops.h"

#define N 2
#define NAME(method) method##_spring_pendulum
#define RHS
#define F(t, u, v, a) spring_pendulum(t, u, v, p, a)
#include "vector_loops.h"
