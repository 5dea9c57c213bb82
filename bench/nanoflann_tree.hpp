#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

/// The peer of grid_bench: a k-d tree of nanoflann over points of the plane. No type of Eigen in here: the file behind
/// is compiled for the machine, as the grid's inner loop is.
class NanoflannTree {
public:
    explicit NanoflannTree(std::vector<double> points);  ///< point after point
    ~NanoflannTree();
    NanoflannTree(const NanoflannTree&) = delete;
    NanoflannTree& operator=(const NanoflannTree&) = delete;

    /// Squared distance of the k-th nearest of every point of the tree; all k neighbours are found.
    [[nodiscard]] std::vector<double> farthest_of(std::size_t k) const;

private:
    struct Implementation;
    std::unique_ptr<Implementation> implementation_;
};
