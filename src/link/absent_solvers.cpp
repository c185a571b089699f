// Stand-ins for the solvers that a static Ceres refers to and nothing here asks it for: the sparse
// ones of SuiteSparse and CXSparse, the dense ones of LAPACK. Ceres solves with Eigen's, see
// trajectory/ceres_minimum.cpp. Defined here, they keep those libraries, of which parts are under
// the GPL, out of what is linked.
#include <cstdio>
#include <cstdlib>

namespace {

[[noreturn]] void Fail(const char* name) {
  std::fprintf(stderr, "%s: unlidar_track is linked without this solver\n", name);
  std::abort();
}

}  // namespace

// Ceres calls them by their own declarations; of these here only the names count.
#define ABSENT(name) \
  extern "C" [[noreturn]] void name() { Fail(#name); }

// NOLINTBEGIN(readability-identifier-naming)
ABSENT(cholmod_amd)
ABSENT(cholmod_analyze)
ABSENT(cholmod_analyze_p)
ABSENT(cholmod_camd)
ABSENT(cholmod_factorize)
ABSENT(cholmod_finish)
ABSENT(cholmod_free_dense)
ABSENT(cholmod_free_factor)
ABSENT(cholmod_free_sparse)
ABSENT(cholmod_print_common)
ABSENT(cholmod_solve)
ABSENT(cholmod_start)
ABSENT(cholmod_triplet_to_sparse)
ABSENT(cholmod_zeros)

ABSENT(cs_di_amd)
ABSENT(cs_di_calloc)
ABSENT(cs_di_chol)
ABSENT(cs_di_cholsol)
ABSENT(cs_di_compress)
ABSENT(cs_di_counts)
ABSENT(cs_di_cumsum)
ABSENT(cs_di_etree)
ABSENT(cs_di_free)
ABSENT(cs_di_ipvec)
ABSENT(cs_di_lsolve)
ABSENT(cs_di_ltsolve)
ABSENT(cs_di_malloc)
ABSENT(cs_di_multiply)
ABSENT(cs_di_nfree)
ABSENT(cs_di_pinv)
ABSENT(cs_di_post)
ABSENT(cs_di_pvec)
ABSENT(cs_di_schol)
ABSENT(cs_di_sfree)
ABSENT(cs_di_spfree)
ABSENT(cs_di_symperm)
ABSENT(cs_di_transpose)

ABSENT(dgeqrf_)
ABSENT(dormqr_)
ABSENT(dpotrf_)
ABSENT(dpotrs_)
ABSENT(dtrtrs_)
// NOLINTEND(readability-identifier-naming)
