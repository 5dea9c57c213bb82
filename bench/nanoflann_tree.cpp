#include "bench/nanoflann_tree.hpp"

#include <utility>

#include <nanoflann.hpp>

namespace {

struct Cloud {
    std::vector<double> points;
    [[nodiscard]] std::size_t kdtree_get_point_count() const { return points.size() / 2; }
    [[nodiscard]] double kdtree_get_pt(std::size_t i, std::size_t d) const { return points[2 * i + d]; }
    template <class Box>
    bool kdtree_get_bbox(Box&) const {
        return false;
    }
};

using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Cloud>, Cloud, 2, std::uint32_t>;

}  // namespace

struct NanoflannTree::Implementation {
    explicit Implementation(std::vector<double> points)
        : cloud{std::move(points)}, tree(2, cloud, nanoflann::KDTreeSingleIndexAdaptorParams(10)) {
        tree.buildIndex();
    }
    Cloud cloud;
    Tree tree;
};

NanoflannTree::NanoflannTree(std::vector<double> points)
    : implementation_(std::make_unique<Implementation>(std::move(points))) {}

NanoflannTree::~NanoflannTree() = default;

std::vector<double> NanoflannTree::farthest_of(std::size_t k) const {
    const std::size_t count = implementation_->cloud.kdtree_get_point_count();
    std::vector<double> result(count);
    std::vector<std::uint32_t> indices(k);
    std::vector<double> distances(k);
    for (std::size_t i = 0; i < count; ++i) {
        implementation_->tree.knnSearch(implementation_->cloud.points.data() + 2 * i, k, indices.data(),
                                        distances.data());
        result[i] = distances.back();
    }
    return result;
}
