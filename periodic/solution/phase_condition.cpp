#include "periodic/solution/phase_condition.hpp"

#include <cstddef>
#include <vector>

namespace orbid::periodic {

std::optional<PhaseCondition> phase_condition(const models::System& system, const VectorXd& theta,
                                              const MatrixXd& guess, std::span<const double> shares,
                                              const std::optional<models::Section>& section, PhaseChoice choice) {
    if (system.kind() != models::Kind::autonomous) return std::nullopt;
    if (section) return PhaseCondition{section->normal, section->offset};
    const Index used = choice == PhaseChoice::integral ? guess.cols() : 1;
    PhaseCondition condition;
    condition.normals =
        system.rhs(guess.leftCols(used), std::vector<double>(static_cast<std::size_t>(used), 0.0), theta);
    for (Index j = 0; used > 1 && j < used; ++j) {
        const auto at = static_cast<std::size_t>(j);
        const double before = j > 0 ? shares[at - 1] : shares[static_cast<std::size_t>(used - 1)] - 1.0;
        const double after = j + 1 < used ? shares[at + 1] : 1.0;
        condition.normals.col(j) *= 0.5 * (after - before);
    }
    condition.offset = condition.normals.cwiseProduct(guess.leftCols(used)).sum();
    return condition;
}

}  // namespace orbid::periodic
