#include "orbits/invariants/invariants.hpp"
#include "orbits/records/refusal.hpp"

namespace orbid::orbits {

Invariants find_invariants(const Series& series, const CycleSearch& search, const InvariantOptions& options) {
    const int complete_to = options.expansion.complete_to;
    refuse_if(!(complete_to >= 0 && complete_to <= 64), "find_invariants: complete_to must be in [0, 64], got {}",
              complete_to);
    Invariants result;
    if (complete_to == 0) {
        result.expansion_refused = "it is not stated up to which period the list of cycles is complete";
    } else {
        try {
            result.expansion = expand_cycles(search.cycles, options.expansion);
        } catch (const DataError& refusal) {
            result.expansion_refused = refusal.what();
        }
    }
    result.lyapunov = lyapunov_spectrum(series, options.lyapunov);
    result.correlation = correlation_dimension(series, options.correlation);
    return result;
}

}  // namespace orbid::orbits
