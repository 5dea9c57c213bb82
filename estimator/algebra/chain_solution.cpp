#include <cmath>

#include "estimator/algebra/block_loop.hpp"
#include "estimator/algebra/chain.hpp"

namespace orbid::estimator {

void solve_chain(const ChainFactor& chain, const Eigen::VectorXd& d, std::vector<Eigen::VectorXd>& z) {
    const Eigen::Index q = d.size();
    for (auto level = chain.levels.rbegin(); level != chain.levels.rend(); ++level) {
        for_pieces(level->steps.size(), [&](std::size_t begin, std::size_t end, std::size_t) {
            std::vector<double> right;
            for (std::size_t s = begin; s < end; ++s) {
                const Elimination& step = level->steps[s];
                const Eigen::Map<const Eigen::MatrixXd> rows = level->rows(step);
                const Eigen::Index rank = step.rank;
                right.assign(rows.col(rows.cols() - 1).data(), rows.col(rows.cols() - 1).data() + rank);
                const auto add = [&](Eigen::Index column, double x) {
                    const double* values = rows.col(column).data();
                    for (Eigen::Index k = 0; k < rank; ++k)
                        right[static_cast<std::size_t>(k)] += values[k] * x;
                };
                for (Eigen::Index j = 0; j < q; ++j)
                    add(rows.cols() - 1 - q + j, d[j]);
                Eigen::Index column = rank;
                for (const std::ptrdiff_t neighbour : {step.left, step.right}) {
                    if (neighbour < 0) continue;
                    const Eigen::VectorXd& known = z[chain.block[static_cast<std::size_t>(neighbour)]];
                    for (Eigen::Index j = 0; j < known.size(); ++j)
                        add(column + j, known[j]);
                    column += known.size();
                }
                for (Eigen::Index k = rank; k-- > 0;) {
                    double sum = right[static_cast<std::size_t>(k)];
                    for (Eigen::Index j = k + 1; j < rank; ++j)
                        sum -= rows(k, j) * right[static_cast<std::size_t>(j)];
                    right[static_cast<std::size_t>(k)] = sum / rows(k, k);
                }
                const auto node = static_cast<std::size_t>(step.node);
                const Eigen::Index l = chain.latents[node];
                Eigen::VectorXd& own = z[chain.block[node]];
                own.setZero(l);
                Eigen::VectorXd* other = nullptr;
                if (step.partner >= 0) {
                    const auto partner = static_cast<std::size_t>(step.partner);
                    other = &z[chain.block[partner]];
                    other->setZero(chain.latents[partner]);
                }
                for (Eigen::Index k = 0; k < rank; ++k) {
                    const Eigen::Index j = level->order[step.first + static_cast<std::size_t>(k)];
                    (j < l ? own[j] : (*other)[j - l]) = -right[static_cast<std::size_t>(k)];
                }
            }
        });
    }
}

double log_abs_determinant(const ChainFactor& chain) {
    double sum = 0.0;
    for (const ChainLevel& level : chain.levels)
        for (const Elimination& step : level.steps) {
            const double* diagonal = level.values.data() + step.place;
            for (Eigen::Index k = 0; k < step.rank; ++k)
                sum += std::log(std::abs(diagonal[k * (step.rank + 1)]));
        }
    return sum;
}

}  // namespace orbid::estimator
