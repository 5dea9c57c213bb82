#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "identification/problem/estimate_setup.hpp"
#include "identification/problem/identification_problem.hpp"

namespace orbid::identification {

/// Parameters of the estimate that the readings alone have to determine, and how those of the model follow from them.
struct SharedUnknowns {
    std::vector<std::size_t> parameter;  ///< index into EstimateSetup::parameters
    std::vector<Eigen::Index> column;    ///< per parameter of the setup: its unknown, -1: none
    std::vector<double> factor;          ///< per parameter of the setup, on its unknown
    std::vector<bool> known;             ///< per unknown: a prior says something about it

    [[nodiscard]] Eigen::Index size() const { return static_cast<Eigen::Index>(parameter.size()); }
};

/// Without initial values, delays of inputs (which no equation contains), and followers of others.
[[nodiscard]] SharedUnknowns shared_unknowns(const IdentificationProblem& problem, const EstimateSetup& setup);

/// What one course says.
struct CourseInformation {
    std::size_t experiment = 0, index = 0, draw = 0;
    std::vector<Eigen::Index> own;  ///< coordinates whose first value is unknown
    Eigen::VectorXd state;          ///< shape (n), at the beginning
    double phase = 0.0;
    Eigen::MatrixXd by_own, by_shared, own_terms, shared_terms;  ///< as in RankTest::add()
    std::vector<bool> silent;  ///< per observed coordinate: its reading depends on nothing

    [[nodiscard]] bool usable() const { return by_shared.rows() > 0; }
};

/// Courses of the model in the records of a problem, with the derivatives of their readings.
class CourseDraws {
public:
    CourseDraws(const IdentificationProblem& problem, const EstimateSetup& setup, const SharedUnknowns& shared);

    /// The parameters of a draw, shape (estimate's parameters): within a tenth of the start, inside bounds.
    [[nodiscard]] Eigen::VectorXd parameters(std::size_t draw) const;
    /// Course `index` of an experiment; the first begin where fitted segments do, the others anywhere in them.
    [[nodiscard]] CourseInformation course(std::size_t experiment, std::size_t index, std::size_t draw) const;
    /// That many courses say all that a record can.
    [[nodiscard]] std::size_t courses(std::size_t experiment) const;
    /// The model with the inputs of the segment that a course is in.
    [[nodiscard]] const models::System& system(std::size_t experiment, std::size_t index) const;

private:
    struct Place {
        std::size_t segment;  ///< of the fitted ones
        Eigen::Index sample;
    };
    [[nodiscard]] Place place(std::size_t experiment, std::size_t index, std::size_t draw) const;
    [[nodiscard]] Eigen::VectorXd state_at(std::size_t experiment, const Place& place, std::size_t draw,
                                           const Eigen::VectorXd& theta, double unread) const;

    const IdentificationProblem& problem_;
    const EstimateSetup& setup_;
    const SharedUnknowns& shared_;
    std::vector<std::vector<std::size_t>> segments_;  ///< fitted, by experiment
    std::vector<std::vector<std::shared_ptr<const models::System>>> systems_;
};

/// Numbers in (0, 1) that depend on their indices alone: the same for every job and seed.
[[nodiscard]] double generic_number(std::size_t draw, std::size_t index, std::size_t position);

}  // namespace orbid::identification
