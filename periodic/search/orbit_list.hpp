#pragma once

#include <cstddef>
#include <optional>
#include <vector>

#include "periodic/orbit/eigen_names.hpp"
#include "periodic/search/model_section.hpp"
#include "periodic/search/orbit_search.hpp"

namespace orbid::periodic {

/// Points of an orbit in the order that begins with the smallest first coordinate. Ties to 1e-9 of `size` are decided
/// by the smallest second one, and so on. @param points  shape (n, p), angles in (-pi, pi].
[[nodiscard]] MatrixXd in_canonical_order(const MatrixXd& points, const VectorXd& size);

/// Orbits found so far, each once.
class OrbitList {
public:
    /// @param size  shape (n), > 0: extent of each coordinate; points closer than 1e-6 of it are the same.
    OrbitList(const ModelSection& section, VectorXd size, ShootingOptions solver);

    /// Adds points of a closed orbit found with low accuracy. They are shortened to the prime period, compared with the
    /// known orbits, then solved to full accuracy, with the mirror image when wanted.
    /// @return index of the new orbit, none when it was known (its hits are counted) or is lost at full accuracy.
    std::optional<std::size_t> add(const MatrixXd& points, StartOrigin origin, bool mirror);

    [[nodiscard]] const std::vector<FoundOrbit>& orbits() const { return orbits_; }
    /// The known orbit that passes all these points, in their order, within `radius` of `size`; none if there is none.
    [[nodiscard]] std::optional<std::size_t> find(const MatrixXd& points, double radius) const;

private:
    std::optional<std::size_t> insert(const MatrixXd& points, StartOrigin origin);
    void look_for_mirror(std::size_t index);

    const ModelSection& section_;
    VectorXd size_;
    ShootingOptions solver_;
    std::vector<Index> angles_;
    std::vector<FoundOrbit> orbits_;
};

/// The mirror image of an orbit by the model's symmetry, in the same section. None for a model without symmetry, or
/// when the flow cannot be followed there. Accurate to the flow's error over one return: a start.
[[nodiscard]] std::optional<MatrixXd> mirror_image(const ModelSection& section, const PeriodicOrbit& orbit,
                                                   const models::FlowOptions& flow);

}  // namespace orbid::periodic
