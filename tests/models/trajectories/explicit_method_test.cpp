#include "models/trajectories/explicit_method.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <vector>

#include "tests/catch.hpp"

namespace orbid::models::explicit_method_test {

namespace {

/// A rooted tree: the trees that hang from its root, sorted. Order conditions: Butcher's theorem,
///     sum_i b_i Phi_i(t) = 1 / gamma(t) for every tree t with at most `order` nodes.
struct Tree {
    std::vector<const Tree*> branches;
    std::size_t nodes = 1;
    long double gamma = 1.0L;
};

/// All rooted trees by their number of nodes, each once.
class Forest {
public:
    explicit Forest(std::size_t nodes) : trees_(nodes + 1) {
        for (std::size_t k = 1; k <= nodes; ++k) {
            std::vector<const Tree*> branches;
            grow(k, k - 1, branches);
        }
    }
    [[nodiscard]] const std::vector<const Tree*>& of(std::size_t nodes) const { return trees_[nodes]; }

private:
    /// Adds branches with `left` nodes in all, in the order in which trees were made, so that no set comes twice.
    void grow(std::size_t nodes, std::size_t left, std::vector<const Tree*>& branches) {
        if (left == 0) {
            auto tree = std::make_unique<Tree>(Tree{branches, nodes, static_cast<long double>(nodes)});
            for (const Tree* branch : branches)
                tree->gamma *= branch->gamma;
            trees_[nodes].push_back(tree.get());
            rank_[tree.get()] = all_.size();
            all_.push_back(std::move(tree));
            return;
        }
        const std::size_t first = branches.empty() ? 0 : rank_[branches.back()];
        for (std::size_t i = first; i < all_.size(); ++i) {
            if (all_[i]->nodes > left) break;
            branches.push_back(all_[i].get());
            grow(nodes, left - all_[i]->nodes, branches);
            branches.pop_back();
        }
    }

    std::vector<std::unique_ptr<Tree>> all_;
    std::map<const Tree*, std::size_t> rank_;
    std::vector<std::vector<const Tree*>> trees_;
};

template <std::size_t S>
std::array<long double, S> elementary_weights(const ExplicitMethod<S>& method, const Tree& tree) {
    std::array<long double, S> weight;
    weight.fill(1.0L);
    for (const Tree* branch : tree.branches) {
        const auto inner = elementary_weights(method, *branch);
        for (std::size_t i = 0; i < S; ++i) {
            long double sum = 0.0L;
            for (std::size_t j = 0; j < i; ++j)
                sum += static_cast<long double>(method.matrix[i][j]) * inner[j];
            weight[i] *= sum;
        }
    }
    return weight;
}

/// Largest violation over all trees with so many nodes, of the method and of the embedded one (whose weights are those
/// of the method minus those of the error).
template <std::size_t S>
std::pair<double, double> violation(const ExplicitMethod<S>& method, const std::vector<const Tree*>& trees) {
    long double worst = 0.0L, worst_embedded = 0.0L;
    for (const Tree* tree : trees) {
        const auto weight = elementary_weights(method, *tree);
        long double sum = 0.0L, error = 0.0L;
        for (std::size_t i = 0; i < S; ++i) {
            sum += method.weights[i] * weight[i];
            error += method.error[i] * weight[i];
        }
        worst = std::max(worst, std::abs(sum - 1.0L / tree->gamma));
        worst_embedded = std::max(worst_embedded, std::abs(sum - error - 1.0L / tree->gamma));
    }
    return {static_cast<double>(worst), static_cast<double>(worst_embedded)};
}

}  // namespace

TEST_CASE("explicit methods fulfil all conditions of their order", "[models][reference]") {
    const Forest forest(10);
    // Cayley's numbers of rooted trees.
    const std::array<std::size_t, 11> counts{0, 1, 1, 2, 4, 9, 20, 48, 115, 286, 719};
    for (std::size_t nodes = 1; nodes <= 10; ++nodes)
        REQUIRE(forest.of(nodes).size() == counts[nodes]);
    const auto& method = verner98;
    // Coefficients are rounded to 53 bits, the largest is 36: measured 4e-16 and 1.3e-15, times ten.
    for (int order = 1; order <= method.order; ++order) {
        CAPTURE(order);
        CHECK(violation(method, forest.of(static_cast<std::size_t>(order))).first < 4e-15);
        if (order < method.error_order)
            CHECK(violation(method, forest.of(static_cast<std::size_t>(order))).second < 1.3e-14);
    }
    CHECK(violation(method, forest.of(static_cast<std::size_t>(method.order) + 1)).first > 1e-7);
    CHECK(violation(method, forest.of(static_cast<std::size_t>(method.error_order))).second > 1e-6);
    // Nodes are the sums of their rows; quadrature is seen by the estimate: sum e_i c_i^(error_order - 1) is not 0.
    long double quadrature = 0.0L;
    for (std::size_t i = 0; i < method.stages; ++i) {
        long double sum = 0.0L;
        for (std::size_t j = 0; j < i; ++j)
            sum += static_cast<long double>(method.matrix[i][j]);
        CHECK(std::abs(static_cast<double>(sum - method.nodes[i])) < 1e-14);
        quadrature += method.error[i] * std::pow(static_cast<long double>(method.nodes[i]), method.error_order - 1);
    }
    CHECK(std::abs(static_cast<double>(quadrature)) > 1e-6);
}

}  // namespace orbid::models::explicit_method_test
