// The accumulator against one register: what is taken is all that was added to an address since it was taken last, however
// near each other operations are. The address is any; an operation may come in every cycle. Bounded: for 14 cycles.
module accumulator_proof (
    input logic       clk,
    input logic       valid,
    input logic       take,
    input logic [1:0] address,
    input logic [3:0] addend,
    input logic [1:0] watched
);
    
    logic [3:0] age = 0;  // the first four cycles clean every word
    wire        sweep = age < 4;
    logic [3:0] sum = 0, sum1, sum2;
    logic       taking1 = 0, taking2 = 0;
    wire        hit = !sweep && valid && address == watched;
    wire  [3:0] taken;

    accumulator #(.WIDTH(4), .DEPTH(4)) charges (
        .clk, .valid(valid && !sweep), .take, .address, .addend, .taken, .sweep, .sweep_address(age[1:0])
    );

    always_ff @(posedge clk) begin
        if (sweep) age <= age + 1;
        if (hit) sum <= take ? 4'd0 : sum + addend;
        {taking1, sum1} <= {hit && take, sum};
        {taking2, sum2} <= {taking1, sum1};
        if (taking2) assert (taken == sum2);
    end

    logic [1:0] before;
    always_ff @(posedge clk) begin
        before <= watched;
        if (age != 0) assume (watched == before);
    end
endmodule
