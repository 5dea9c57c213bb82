// Sums over ranks: exact numbers, the same bytes everywhere, and clear errors where ranks do not act alike.

#include <cmath>
#include <cstring>
#include <stdexcept>
#include <string>
#include <vector>

#include "estimator/ranks/collective.hpp"
#include "tests/catch.hpp"
#include "tests/estimator/ranks/on_ranks.hpp"

using namespace orbid::estimator;
using orbid::tests::on_ranks;

TEST_CASE("Ranks add up numbers and take over those of rank 0", "[ranks]") {
    for (const int count : {1, 2, 3, 4, 5, 8, 13}) {
        CAPTURE(count);
        std::vector<std::vector<double>> found(static_cast<std::size_t>(count));
        std::vector<char> any(static_cast<std::size_t>(count), 0);
        on_ranks(count, [&](Ranks& ranks) {
            Collective all(ranks);
            const auto own = static_cast<std::size_t>(ranks.rank());
            std::vector<double> values{static_cast<double>(own), 1.0, std::sin(1.0 + static_cast<double>(own))};
            all.sum(values);
            std::vector<double> told{static_cast<double>(own) + 7.0};
            all.tell(told);
            values.push_back(told[0]);
            any[own] = static_cast<char>((all.any(ranks.rank() == count - 1) ? 1 : 0) + (all.any(false) ? 2 : 0));
            found[own] = values;
        });
        for (std::size_t rank = 0; rank < found.size(); ++rank) {
            CHECK(found[rank][0] == 0.5 * count * (count - 1));
            CHECK(found[rank][1] == count);
            CHECK(std::memcmp(&found[rank][2], &found[0][2], sizeof(double)) == 0);
            CHECK(found[rank][3] == 7.0);
            CHECK(any[rank] == 1);
        }
    }
}

TEST_CASE("Numbers of a message come out as they went in", "[ranks]") {
    RankNumbers numbers;
    numbers.put(0.1);
    numbers.put(Eigen::MatrixXd(0, 3));
    numbers.put(Eigen::MatrixXd{{1.0, 2.0, 3.0}, {4.0, 5.0, 6.0}});
    CHECK(numbers.take() == 0.1);
    const Eigen::MatrixXd none = numbers.take_matrix();
    CHECK(none.rows() == 0);
    CHECK(none.cols() == 3);
    CHECK(numbers.take_matrix() == Eigen::MatrixXd{{1.0, 2.0, 3.0}, {4.0, 5.0, 6.0}});
    CHECK_THROWS_AS(numbers.take(), std::runtime_error);
}

TEST_CASE("A rank that ends or does something else is told, not waited for", "[ranks]") {
    const auto message_of = [](int count, const auto& work) {
        try {
            on_ranks(count, work);
        } catch (const std::exception& error) {
            return std::string(error.what());
        }
        return std::string();
    };
    CHECK(message_of(3, [](Ranks& ranks) {
              Collective all(ranks);
              double value = 1.0;
              if (ranks.rank() != 2) all.sum({&value, 1});
          }) == "rank 2 has ended before the computation did");
    CHECK(message_of(2, [](Ranks& ranks) {
              Collective all(ranks);
              double value = 1.0;
              all.sum({&value, 1});
              if (ranks.rank() == 1)
                  all.sum({&value, 1});
              else
                  all.begin(Collective::Operation::condense), static_cast<void>(all.receive(1));
          }).find("not at the same operation") != std::string::npos);
}
