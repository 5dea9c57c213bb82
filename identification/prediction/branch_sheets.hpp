#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include <Eigen/Core>

#include "periodic/branches/branch.hpp"

namespace orbid::identification {

/// A place along a branch that other branches have, too: a fold, another bifurcation, an end.
struct BranchMark {
    std::string
        name;  ///< "fold 1": the first one on the way from the start towards larger values, "fold -1": to smaller
    std::string kind;  ///< "fold", "period_doubling", ..., "equilibrium": what it is
    double parameter = 0.0;
};

/// A followed branch in sheets between its folds: on each of them every value of the parameter has one orbit at most.
/// Sheets are counted from that of the start, 0, on the way on which the parameter grows there; the sheets of two
/// branches with starts alike correspond.
class BranchSheets {
public:
    /// @param quantities  of the branch's points, one column each
    /// @param start       the value of the parameter at the start, a point of the branch
    /// @param near        the state at the start: of several points with that value the nearest to it is the start
    BranchSheets(const periodic::Branch& branch, const Eigen::MatrixXd& quantities, double start,
                 const Eigen::VectorXd& near);

    /// The sheet of a point of the branch, in its own order; of a fold the one towards the start.
    [[nodiscard]] int sheet_of(std::size_t point) const { return sheets_[place_of(point)]; }
    [[nodiscard]] std::pair<int, int> range() const { return {lowest_, highest_}; }
    /// The quantities at a value of the parameter, by cubic interpolation in the arclength; the last `linear` of them
    /// by a linear one: moduli of multipliers have corners. Nothing beyond the ends of the sheet.
    [[nodiscard]] std::optional<Eigen::VectorXd> at(int sheet, double parameter, Eigen::Index linear) const;
    /// The folds by the sheets between which they are, other bifurcations and ends in the order from the start.
    [[nodiscard]] const std::vector<BranchMark>& marks() const { return marks_; }

private:
    [[nodiscard]] std::size_t place_of(std::size_t point) const {
        return reversed_ ? parameter_.size() - 1 - point : point;
    }
    void find_sheets(std::size_t start);
    void find_marks(const periodic::Branch& branch, std::size_t start);

    bool reversed_ = false;
    std::vector<double> parameter_, arclength_;
    Eigen::MatrixXd quantities_;
    std::vector<int> sheets_;           ///< of points
    std::vector<int> interval_sheets_;  ///< of the intervals between them
    int lowest_ = 0, highest_ = 0;
    std::vector<BranchMark> marks_;
};

}  // namespace orbid::identification
